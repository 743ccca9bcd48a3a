// Coulomb friction: constant torque against the motion.  T_load += T_C tanh(omega_m/omega_smooth)
//
// The tanh replaces sign(omega_m), so that the right-hand side of the plant is smooth; above 3
// omega_smooth it is within 0.5 % of the sign. Regressor: tanh(omega_m/omega_smooth); coefficient
// T_C.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"

namespace twinrate {
namespace {

class CoulombFriction final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "coulomb_friction"; }
  std::string_view meaning() const override { return "constant torque against the motion"; }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("torque_Nm", T_C_, -1e4, 1e4, "friction torque", Presence::kRequired);
    f.number("smooth_rad_s", omega_smooth_, 1e-6, 1e3, "speed scale of the sign's smoothing");
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<CoulombFriction>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = T_C_ * smooth_sign(point.omega_m, omega_smooth_)};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = smooth_sign(point.omega_m, omega_smooth_)};
  }
  void coefficients(std::span<double> values) const override { values[0] = T_C_; }
  void set_coefficients(std::span<const double> values) override { T_C_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "torque_Nm", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(T_C_) / smallest_torque(facts, 10e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kFriction, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kYes,
            .view = View::kTorqueOverSpeed,
            .told_by = Run::kConstantSpeeds,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "torque_Nm = 0.25\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "T_load += T_C tanh(omega_m/omega_smooth)",
        .shows =
            "A step of the estimated load torque at a change of sign of the speed, with a bump in "
            "the speed; no order at constant speed.",
        .taken_for = "`constant_load` in one direction; `viscous_friction` at one speed."};
    return kPortrait;
  }

 private:
  double T_C_ = 0;
  double omega_smooth_ = kSmoothSpeed;
};

}  // namespace

std::shared_ptr<Effect> make_coulomb_friction() {
  return std::make_shared<CoulombFriction>();
}

}  // namespace twinrate

// Stribeck friction: the excess of dry friction at low speed, until the film of grease carries.
//
//   T_load += T_S exp(-(|omega_m|/omega_S)^exponent) tanh(omega_m/omega_smooth)
//
// T_S is the excess over Coulomb friction: break-away torque less Coulomb torque. Exponent 2
// (default) is Armstrong-Helouvry's form, 1 is Tustin's. Regressor: the product of exponential and
// tanh at given omega_S; coefficient T_S.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class StribeckFriction final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "stribeck_friction"; }
  std::string_view meaning() const override {
    return "dry friction that falls with speed, beyond Coulomb";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("torque_Nm", T_S_, -1e4, 1e4, "excess over Coulomb friction at standstill",
             Presence::kRequired);
    f.number("speed_rad_s", omega_S_, 1e-4, 1e4, "speed at which 1/e of it is left",
             Presence::kRequired);
    f.number("exponent", exponent_, 0.5, 4, "of the fall: 2 Gaussian, 1 exponential");
    f.number("smooth_rad_s", omega_smooth_, 1e-6, 1e3, "speed scale of the sign's smoothing");
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<StribeckFriction>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = T_S_ * shape(point.omega_m)};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = shape(point.omega_m)};
  }
  void coefficients(std::span<double> values) const override { values[0] = T_S_; }
  void set_coefficients(std::span<const double> values) override { T_S_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{"speed_rad_s", {0.5, 1, 2, 4, 8, 16}}, {.key = "torque_Nm", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(T_S_) / smallest_torque(facts, 20e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kFriction, 2},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kGrid,
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
        .parameters = "torque_Nm = 0.1\nspeed_rad_s = 3.0\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "T_load += T_S exp(-(|omega_m|/omega_S)^exponent) tanh(omega_m/omega_smooth)",
        .shows =
            "Load torque that falls with rising speed: two humps beside standstill. The negative "
            "damping there causes stick-slip of slow drives.",
        .taken_for = "`coulomb_friction` at low speed only."};
    return kPortrait;
  }

 private:
  double shape(double omega_m) const {
    const double x = std::abs(omega_m) / omega_S_;
    const double power = exponent_ == 2 ? x * x : exponent_ == 1 ? x : math::pow(x, exponent_);
    return math::exp(-power) * smooth_sign(omega_m, omega_smooth_);
  }

  double T_S_ = 0;
  double omega_S_ = 1;
  double exponent_ = 2;
  double omega_smooth_ = kSmoothSpeed;
};

}  // namespace

std::shared_ptr<Effect> make_stribeck_friction() {
  return std::make_shared<StribeckFriction>();
}

}  // namespace twinrate

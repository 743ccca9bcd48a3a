// Viscous friction beyond the machine's B: bearings, grease, eddy currents.  T_load += b omega_m
//
// Regressor: omega_m; coefficient b. B itself is in [machine]: only the sum is identifiable.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class ViscousFriction final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "viscous_friction"; }
  std::string_view meaning() const override {
    return "torque proportional to the speed, in addition to machine.B";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("coefficient_Nms", b_, -1e3, 1e3, "torque at 1 rad/s", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<ViscousFriction>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = b_ * point.omega_m};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = point.omega_m};
  }
  void coefficients(std::span<double> values) const override { values[0] = b_; }
  void set_coefficients(std::span<const double> values) override { b_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "coefficient_Nms", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(b_) * rated_speed(facts) / smallest_torque(facts, 15e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kFriction, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kBeyondViscosity,
            .view = View::kTorqueOverSpeed,
            .told_by = Run::kConstantSpeeds,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "coefficient_Nms = 0.05\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "T_load += b omega_m",
        .shows = "A straight line of the estimated load torque over the speed.",
        .taken_for =
            "`machine.B_Nms`: only the sum can be identified; `coulomb_friction` at one speed."};
    return kPortrait;
  }

 private:
  double b_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_viscous_friction() {
  return std::make_shared<ViscousFriction>();
}

}  // namespace twinrate

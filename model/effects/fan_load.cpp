// Fan load: torque that grows with the square of the speed.  T_load += c omega_m |omega_m|
//
// Regressor: omega_m |omega_m|; coefficient c.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class FanLoad final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "fan_load"; }
  std::string_view meaning() const override {
    return "torque with the square of the speed: fan, propeller, pump";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("coefficient_Nms2", c_, -1e3, 1e3, "torque at 1 rad/s", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<FanLoad>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = c_ * point.omega_m * std::abs(point.omega_m)};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = point.omega_m * std::abs(point.omega_m)};
  }
  void coefficients(std::span<double> values) const override { values[0] = c_; }
  void set_coefficients(std::span<const double> values) override { c_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "coefficient_Nms2", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    const double omega_m = rated_speed(facts);
    return std::abs(c_) * (omega_m * omega_m) / smallest_torque(facts, 15e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kFriction, 3},
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
        .parameters = "coefficient_Nms2 = 0.01\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "T_load += c omega_m |omega_m|",
        .shows = "The estimated load torque is a parabola over the speed, odd in the direction.",
        .taken_for = "`viscous_friction` over a narrow range of speed."};
    return kPortrait;
  }

 private:
  double c_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_fan_load() {
  return std::make_shared<FanLoad>();
}

}  // namespace twinrate

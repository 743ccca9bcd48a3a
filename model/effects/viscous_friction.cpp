// Viscous friction beyond the machine's B: bearings, grease, eddy currents.  T_load += b omega_m
//
// Regressor: omega_m; coefficient b. B itself stands in [machine]: only the sum can be identified.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class ViscousFriction final : public Effect {
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
  bool is_loss() const override { return true; }
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

 private:
  double b_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_viscous_friction() {
  return std::make_shared<ViscousFriction>();
}

}  // namespace twinrate

// Voltage that is not what was asked for, in proportion: a bus voltage read wrong.
//
//   u = (1 + gain) asked,  u_dq_drop = -gain u_dq
//
// Regressor: -u_dq; coefficient gain.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class VoltageGain final : public Effect {
 public:
  std::string_view kind() const override { return "voltage_gain"; }
  std::string_view meaning() const override {
    return "error of the applied voltage proportional to the voltage";
  }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("gain", gain_, -0.9, 10, "true/asked - 1", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<VoltageGain>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = -gain_ * point.u_dq};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.u_dq_drop = -point.u_dq};
  }
  void coefficients(std::span<double> values) const override { values[0] = gain_; }
  void set_coefficients(std::span<const double> values) override { gain_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("gain")}; }
  double materiality(const DriveFacts&) const override { return std::abs(gain_) / 0.006; }

 private:
  double gain_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_voltage_gain() {
  return std::make_shared<VoltageGain>();
}

}  // namespace twinrate

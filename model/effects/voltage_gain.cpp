// Voltage that differs from the request in proportion: a wrong reading of the bus voltage.
//
//   u = (1 + gain) requested,  u_dq_drop = -gain u_dq
//
// Regressor: -u_dq; coefficient gain.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class VoltageGain final : public TraceableEffect {
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

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"resistance", Run::kFastWithoutLoad},
                                              {"flux_linkage", Run::kLoadStepsAndCurrents}};
    static constexpr Bound kBounds[] = {{"gain", 0.3}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kInverter, 3},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kYes,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = none,
            .bounds = kBounds,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "gain = 0.05\n",
        .signal = Portrait::kUq,
        .over = Portrait::kOverSpeed,
        .equation = "u = (1 + gain) asked",
        .shows = "Every commanded voltage is smaller by the gain; currents, torque and speed stay.",
        .taken_for = "`flux_linkage` and `resistance` together, in the voltage alone."};
    return kPortrait;
  }

 private:
  double gain_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_voltage_gain() {
  return std::make_shared<VoltageGain>();
}

}  // namespace twinrate

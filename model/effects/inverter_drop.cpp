// Voltage drop of the switches.
//
//   drop of a phase = V_0 sat(i/i_linear) + R_on i
//   sat(x) = max(-1, min(1, x)), or by `shape`
//
// V_0 is the forward voltage of transistor or diode, R_on its slope, which only temperature
// separates from R_s. Regressors: Park(Clarke(sat)), i_dq; coefficients V_0, R_on.
#include <algorithm>

#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class InverterDrop final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "inverter_drop"; }
  std::string_view meaning() const override {
    return "forward voltage and resistance of the switches";
  }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_a", "i_b", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("threshold_V", V_0_, -100, 100, "forward voltage of a switch", Presence::kRequired);
    f.number("resistance_Ohm", R_on_, 0, 100, "slope of the forward voltage");
    f.number("linear_current_A", i_linear_, 1e-6, 1e3,
             "current below which the forward voltage shrinks");
    f.choice("shape", shape_, kCurrentShapeNames, "how the forward voltage grows with the current");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<InverterDrop>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = V_0_ * signs(point) + R_on_ * point.i_terminal_mean()};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.u_dq_drop = signs(point)};
    columns[1] = {.u_dq_drop = point.i_terminal_mean()};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = V_0_;
    values[1] = R_on_;
  }
  void set_coefficients(std::span<const double> values) override {
    V_0_ = values[0];
    R_on_ = values[1];
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("threshold_V"),
            linear_key("resistance_Ohm"),
            {"linear_current_A", {0.03, 0.05, 0.1, 0.17, 0.3, 1}}};
  }
  double materiality(const DriveFacts& facts) const override {
    // 1e-3 of the bus is 0.1 us of dead time at 10 kHz.
    return std::max(std::abs(V_0_) / (1e-3 * facts.v_dc),
                    std::abs(R_on_) / (0.02 * facts.machine.R_s));
  }

  Traits traits() const override {
    static constexpr KeyPair kThreshold[] = {
        {"threshold_V", "dead_time_s", KeyPair::kPerSwitchedVolt},
        {"linear_current_A", "linear_current_A"},
        {"shape", "shape"}};
    static constexpr KeyPair kSlope[] = {{"resistance_Ohm", "change_Ohm"}};
    static constexpr Relative kRelatives[] = {{"dead_time", Run::kTwoBusVoltages},
                                              {"resistance", Run::kWindingAlone}};
    static constexpr Reading kReadings[] = {{Reading::kItsThreshold, "dead_time", kThreshold},
                                            {Reading::kItsSlope, "resistance", kSlope}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kInverter, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kZone,
            .noise = Noise::kSome,
            .on_command = Answer::kNo,
            .loss = Loss::kYes,
            .view = View::kPhaseVoltageOverCurrent,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = kReadings,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "threshold_V = 3.0\nresistance_Ohm = 0.2\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTurns,
        .equation = "drop of a phase = V_0 sat(i/i_linear) + R_on i",
        .shows =
            "As dead time: orders 6 n_p and multiples in the voltages from V_0, and a resistance "
            "from R_on.",
        .taken_for = "`dead_time` (V_0) and `resistance` (R_on)."};
    return kPortrait;
  }

 private:
  Vec2 signs(const OperatingPoint& point) const { return current_signs(point, i_linear_, shape_); }

  double V_0_ = 0;
  double R_on_ = 0;
  double i_linear_ = 0.3;
  CurrentShape shape_ = CurrentShape::kClamp;
};

}  // namespace

std::shared_ptr<Effect> make_inverter_drop() {
  return std::make_shared<InverterDrop>();
}

}  // namespace twinrate

// Winding resistance that differs from machine.R_s, or drifts away from it as the winding warms up.
//
//   Delta_R(t) = change (1 - exp(-(t - start)/tau)),  0 before;  change throughout if tau = 0
//   u_dq_drop = Delta_R i_dq, that of the terminals
//
// Regressor at a given tau: the same for a change of 1; coefficient change. The tracer lets it
// start with the record.
#include <algorithm>
#include <cmath>

#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class Resistance final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "resistance"; }
  std::string_view meaning() const override {
    return "difference of the winding resistance from machine.R_s, constant or drifting";
  }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("change_Ohm", change_, -1e3, 1e3, "true R_s less machine.R_s, in the end",
             Presence::kRequired);
    f.number("time_constant_s", tau_, 0, 1e6, "of the way there; 0: throughout");
    f.number("start_s", start_, -1e9, 1e9, "drive time at which it begins to drift");
  }
  std::string prepare(const DriveFacts& facts) override {
    return facts.machine.R_s + change_ > 0 ? "" : "change_Ohm leaves no resistance";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Resistance>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = change_ * share(point.t) * point.i_terminal()};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.u_dq_drop = share(point.t) * point.i_terminal()};
  }
  void coefficients(std::span<double> values) const override { values[0] = change_; }
  void set_coefficients(std::span<const double> values) override { change_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("change_Ohm"), {"time_constant_s", {0, 1, 2, 5, 10, 20}}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(change_) / (0.02 * facts.machine.R_s);
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"voltage_gain", Run::kFastWithoutLoad},
                                              {"inverter_drop", Run::kWindingAlone}};
    static constexpr Bound kBounds[] = {{"change_Ohm", 5, Bound::kStatorResistance}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kResistance, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kGrid,
            .noise = Noise::kSome,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kResistanceOverTime,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = none,
            .bounds = kBounds,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "change_Ohm = 0.5\ntime_constant_s = 2.0\n",
        .signal = Portrait::kUq,
        .over = Portrait::kOverTime,
        .equation = "u_dq_drop = change (1 - exp(-(t - start)/tau)) i_dq",
        .shows =
            "Voltage along the current, proportional to it, with a drift if the winding warms up. "
            "At low speed it is most of the voltage.",
        .taken_for =
            "`inverter_drop` (resistance), `dead_time` at small current; `phase_asymmetry` but "
            "for its order 2 n_p.",
        .from_s = 0.5,
        .to_s = 8.0};
    return kPortrait;
  }

 private:
  double share(double t) const {
    return tau_ > 0 ? -math::expm1(-std::max(0.0, t - start_) / tau_) : 1;
  }

  double change_ = 0;
  double tau_ = 0;
  double start_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_resistance() {
  return std::make_shared<Resistance>();
}

}  // namespace twinrate

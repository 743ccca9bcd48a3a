// Dead time of the inverter, averaged over a switching period (plant.inverter = "switched" plays it
// edge by edge).       (Niewiara (5), (6))
//
//   drop of a phase = t_d f_pwm v_dc sat(i/i_linear)     sat(x) = max(-1, min(1, x)), or by `shape`
//
// While both switches of a leg are off its current chooses the diode: positive current gets the
// lower rail. Below i_linear the ripple changes the current's sign within a period and the loss
// shrinks. A square wave in each phase: order 6 n_p and its multiples in rotor axes. f_pwm is
// inverter.f_pwm_Hz. Regressor: f_pwm v_dc Park(Clarke(sat)); coefficient t_d.
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class DeadTime final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "dead_time"; }
  std::string_view meaning() const override {
    return "voltage lost while both switches of a leg are off";
  }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_a", "i_b", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("dead_time_s", t_d_, -1e-4, 1e-4, "from switch off to switch on", Presence::kRequired);
    f.number("linear_current_A", i_linear_, 1e-6, 1e3, "current below which the loss shrinks");
    f.choice("shape", shape_, kCurrentShapeNames, "how the loss grows with the current");
  }
  std::string prepare(const DriveFacts& facts) override {
    f_pwm_ = facts.f_pwm;
    return t_d_ * f_pwm_ < 0.5 ? "" : "dead_time_s is half a switching period or more";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<DeadTime>(*this); }
  bool describe_legs(LegFacts& legs) const override {
    legs.dead_time += t_d_;
    return true;
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = t_d_ * drop_a_second(point)};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.u_dq_drop = drop_a_second(point)};
  }
  void coefficients(std::span<double> values) const override { values[0] = t_d_; }
  void set_coefficients(std::span<const double> values) override { t_d_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("dead_time_s"), {"linear_current_A", {0.03, 0.05, 0.1, 0.17, 0.3, 1}}};
  }
  double materiality(const DriveFacts&) const override { return std::abs(t_d_) / 1e-7; }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"inverter_drop", Run::kTwoBusVoltages}};
    static constexpr Reading kReadings[] = {{Reading::kAtOneBusVoltage, "inverter_drop"}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kInverter, 0},
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
        .parameters = "dead_time_s = 3e-6\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTurns,
        .equation =
            "drop of a phase = t_d f_pwm v_dc sat(i/i_linear); edge by edge with plant.inverter "
            "= switched",
        .shows =
            "Orders 6 n_p and its multiples (18, 36) in the voltages and, as far as the current "
            "loop lets them through, in currents and torque; strongest across the current, here in "
            "u_d. A shift of u_q that is similar to a resistance at small current. The switched "
            "inverter has sharper corners: its current ripple at this speed is far below the 0.3 A "
            "of the linear zone of the averaged effect.",
        .taken_for =
            "`inverter_drop` (same shape; only another bus voltage or switching frequency "
            "separates them); `resistance` at small current.",
        .switched = true};
    return kPortrait;
  }

 private:
  Vec2 drop_a_second(const OperatingPoint& point) const {
    return f_pwm_ * point.v_dc * current_signs(point, i_linear_, shape_);
  }

  double t_d_ = 0;
  double i_linear_ = 0.3;
  CurrentShape shape_ = CurrentShape::kClamp;
  double f_pwm_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_dead_time() {
  return std::make_shared<DeadTime>();
}

}  // namespace twinrate

// Constant voltage error of the inverter: legs that do not switch alike.
//
//   u_phase = requested + offset,  u_dq_drop = -Park(Clarke(offset))
//
// In rotor axes it turns at order n_p. A part common to all three phases has no effect, so offsets
// of a and b against c suffice. Regressors: one a phase; coefficients the offsets.
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class InverterOffset final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "inverter_offset"; }
  std::string_view meaning() const override { return "constant error of a phase voltage"; }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_a", "i_b", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("offset_a_V", offset_[0], -1e3, 1e3, "true less asked voltage, phase a against c",
             Presence::kRequired);
    f.number("offset_b_V", offset_[1], -1e3, 1e3, "the same of phase b", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<InverterOffset>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = -point.phases_to_dq({offset_[0], offset_[1], 0})};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.u_dq_drop = -point.phases_to_dq({1, 0, 0})};
    columns[1] = {.u_dq_drop = -point.phases_to_dq({0, 1, 0})};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = offset_[0];
    values[1] = offset_[1];
  }
  void set_coefficients(std::span<const double> values) override {
    offset_ = {values[0], values[1]};
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("offset_a_V"), linear_key("offset_b_V")};
  }
  double materiality(const DriveFacts& facts) const override {
    // 0.05 V of a bus of 235 V: it comes from the duties.
    return offset_.cwiseAbs().maxCoeff() / (0.05 / 235 * facts.v_dc);
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"current_offset", Run::kStandstillWithoutVoltage}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kInverter, 2},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "offset_a_V = 1.0\noffset_b_V = -0.4\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverTurns,
        .equation = "u_phase = asked + offset, an offset a phase against c",
        .shows =
            "Order n_p (here 3) in currents, torque and speed, as far as the loop passes it, and "
            "in the commanded voltages that oppose it; the same at every load and speed.",
        .taken_for =
            "`current_offset` with a stiff current loop: it has the same order. The voltage "
            "equation separates them at different speeds."};
    return kPortrait;
  }

 private:
  Vec2 offset_ = Vec2::Zero();
};

}  // namespace

std::shared_ptr<Effect> make_inverter_offset() {
  return std::make_shared<InverterOffset>();
}

}  // namespace twinrate

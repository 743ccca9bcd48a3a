// Offset of the current sensors, one a phase.  i_meas = i + offset       (Niewiara (1), (2))
//
// Seen in rotor axes it turns at order n_p. With sensors.current_sensors = 2 there is no third
// sensor: offset_c_A means nothing, and the reading of c has -offset_a - offset_b. Regressors: one
// a phase; an offset common to all three does not show in the current vector.
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class CurrentOffset final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "current_offset"; }
  std::string_view meaning() const override { return "constant error of a current sensor"; }
  int acts_on() const override { return kOnCurrents; }
  std::vector<std::string> signals_needed() const override { return {"i_a", "i_b", "theta_m"}; }
  void fields(FieldVisitor& f) override {
    f.number("offset_a_A", offset_[0], -1e3, 1e3, "measured less true current, phase a",
             Presence::kRequired);
    f.number("offset_b_A", offset_[1], -1e3, 1e3, "the same of phase b", Presence::kRequired);
    f.number("offset_c_A", offset_[2], -1e3, 1e3, "the same of phase c");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<CurrentOffset>(*this); }
  Contribution at(const OperatingPoint&) const override { return {.i_abc = offset_}; }
  int regressor_count() const override { return 3; }
  void regressors(const OperatingPoint&, std::span<Contribution> columns) const override {
    for (int phase = 0; phase < 3; ++phase)
      columns[static_cast<std::size_t>(phase)] = {.i_abc = Vec3::Unit(phase)};
  }
  void coefficients(std::span<double> values) const override { put_phases(offset_, values); }
  void set_coefficients(std::span<const double> values) override { offset_ = phases_of(values); }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("offset_a_A"), linear_key("offset_b_A"), linear_key("offset_c_A")};
  }
  double materiality(const DriveFacts& facts) const override {
    return offset_.cwiseAbs().maxCoeff() / (8e-3 / 7 * rated_current(facts));
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"inverter_offset", Run::kStandstillWithoutVoltage}};
    return {.equation = Equation::kSensing,
            .family = {Family::kCurrentSensor, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kSome,
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
        .parameters = "offset_a_A = 0.05\noffset_b_A = -0.02\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverTurns,
        .equation = "i_meas = i + offset, an offset a phase",
        .shows =
            "Order n_p (here 3) in the measured currents, the same at every load. The loop follows "
            "them, so the order appears in true currents, torque and speed, and in the estimated "
            "load torque, which uses the measured currents.",
        .taken_for =
            "`cogging` of order n_p; an offset of the voltages, if no voltage is measured."};
    return kPortrait;
  }

 private:
  Vec3 offset_ = Vec3::Zero();
};

}  // namespace

std::shared_ptr<Effect> make_current_offset() {
  return std::make_shared<CurrentOffset>();
}

}  // namespace twinrate

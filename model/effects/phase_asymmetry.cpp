// Phases of unequal resistance: a bad joint, a long lead.
//
//   drop of a phase = change i
//   u_dq_drop = Park(Clarke([change_a i_a, change_b i_b, change_c i_c]))
//
// In rotor axes it has a constant part, the mean change times the current, and a part of order 2
// n_p from the differences. The mean equals `resistance`. Regressors: one a phase, so that the
// usual case, one phase off, is one coefficient and two zeros; a pair of phases against the third
// would need both and `resistance` as well if the third is the bad one.
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class PhaseAsymmetry final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "phase_asymmetry"; }
  std::string_view meaning() const override {
    return "difference of the resistance of one phase from the others";
  }
  int acts_on() const override { return kOnVoltage; }
  std::vector<std::string> signals_needed() const override {
    return {"i_a", "i_b", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("change_a_Ohm", change_[0], -1e3, 1e3, "true resistance less machine.R_s, phase a",
             Presence::kRequired);
    f.number("change_b_Ohm", change_[1], -1e3, 1e3, "the same of phase b");
    f.number("change_c_Ohm", change_[2], -1e3, 1e3, "the same of phase c");
  }
  std::string prepare(const DriveFacts& facts) override {
    return facts.machine.R_s + change_.minCoeff() > 0 ? "" : "a change leaves no resistance";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<PhaseAsymmetry>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.u_dq_drop = point.phases_to_dq(change_.cwiseProduct(point.i_abc()))};
  }
  int regressor_count() const override { return 3; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const Vec3 i_abc = point.i_abc();
    for (int phase = 0; phase < 3; ++phase)
      columns[static_cast<std::size_t>(phase)] = {
          .u_dq_drop = point.phases_to_dq(i_abc[phase] * Vec3::Unit(phase))};
  }
  void coefficients(std::span<double> values) const override { put_phases(change_, values); }
  void set_coefficients(std::span<const double> values) override { change_ = phases_of(values); }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("change_a_Ohm"), linear_key("change_b_Ohm"), linear_key("change_c_Ohm")};
  }
  double materiality(const DriveFacts& facts) const override {
    // The part beyond a common change of all three.
    return (change_.maxCoeff() - change_.minCoeff()) / (0.02 * facts.machine.R_s);
  }

  Traits traits() const override {
    static constexpr KeyPair kPhases[] = {{"change_a_Ohm", "change_Ohm"},
                                          {"change_b_Ohm", "change_Ohm"},
                                          {"change_c_Ohm", "change_Ohm"}};
    static constexpr Reading kReadings[] = {{Reading::kItsCommonPart, "resistance", kPhases}};
    static constexpr Bound kBounds[] = {{"change_a_Ohm", 5, Bound::kStatorResistance},
                                        {"change_b_Ohm", 5, Bound::kStatorResistance},
                                        {"change_c_Ohm", 5, Bound::kStatorResistance}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kResistance, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kInSum,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = kReadings,
            .bounds = kBounds,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "change_a_Ohm = 0.5\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTurns,
        .equation = "drop of a phase = change i, a change a phase",
        .shows =
            "Order 2 n_p (here 6) in both voltages, proportional to the current, a third of the "
            "change each, and the mean of the three changes as a resistance.",
        .taken_for =
            "`resistance` (the mean); `current_gain`, which has order 2 n_p in the currents."};
    return kPortrait;
  }

 private:
  Vec3 change_ = Vec3::Zero();
};

}  // namespace

std::shared_ptr<Effect> make_phase_asymmetry() {
  return std::make_shared<PhaseAsymmetry>();
}

}  // namespace twinrate

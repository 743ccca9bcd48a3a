// Scaling error of the current sensors, one a phase.  i_meas = (1 + gain) i       (Niewiara (3))
//
// Seen in rotor axes: a constant part and one of order 2 n_p, both in proportion to the current.
// With two sensors (sensors.current_sensors = 2), a d current I and gains g_a, g_b the error of i_q
// is (g_a - g_b) I/sqrt3 [cos(2 theta_e + pi/3) + 1/2] (Chung and Sul 1998). Regressors: the
// current of one phase each.
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class CurrentGain final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "current_gain"; }
  std::string_view meaning() const override {
    return "error of a current sensor proportional to the current";
  }
  int acts_on() const override { return kOnCurrents; }
  std::vector<std::string> signals_needed() const override { return {"i_a", "i_b", "theta_m"}; }
  void fields(FieldVisitor& f) override {
    f.number("gain_a", gain_[0], -0.9, 10, "measured/true - 1, phase a", Presence::kRequired);
    f.number("gain_b", gain_[1], -0.9, 10, "the same of phase b", Presence::kRequired);
    f.number("gain_c", gain_[2], -0.9, 10, "the same of phase c");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<CurrentGain>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.i_abc = gain_.cwiseProduct(point.i_abc())};
  }
  int regressor_count() const override { return 3; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const Vec3 i_abc = point.i_abc();
    for (int phase = 0; phase < 3; ++phase)
      columns[static_cast<std::size_t>(phase)] = {.i_abc = i_abc[phase] * Vec3::Unit(phase)};
  }
  void coefficients(std::span<double> values) const override { put_phases(gain_, values); }
  void set_coefficients(std::span<const double> values) override { gain_ = phases_of(values); }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("gain_a"), linear_key("gain_b"), linear_key("gain_c")};
  }
  double materiality(const DriveFacts&) const override {
    return gain_.cwiseAbs().maxCoeff() / 0.003;
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"flux_linkage", Run::kLoadStepsAndCurrents}};
    static constexpr Bound kBounds[] = {{"gain_a", 0.3}, {"gain_b", 0.3}, {"gain_c", 0.3}};
    return {.equation = Equation::kSensing,
            .family = {Family::kCurrentSensor, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kSlowBothWays,
            .relatives = kRelatives,
            .readings = none,
            .bounds = kBounds,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "gain_a = 0.05\ngain_b = 0.0\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverTurns,
        .equation = "i_meas = (1 + gain) i, a gain a phase",
        .shows =
            "Order 2 n_p (here 6) in the measured currents, and a constant part, both proportional "
            "to the current. The loop determines the share that becomes true current, torque and "
            "speed: here the d integrator makes the measured i_d smooth and the true one rough, "
            "while most of the error of i_q stays in the reading.",
        .taken_for =
            "`cogging` of the same order at one load; a wrong torque constant (the constant "
            "part)."};
    return kPortrait;
  }

 private:
  Vec3 gain_ = Vec3::Zero();
};

}  // namespace

std::shared_ptr<Effect> make_current_gain() {
  return std::make_shared<CurrentGain>();
}

}  // namespace twinrate

// Eccentric load: unbalance under gravity, or a misaligned shaft.  T_load += A sin(theta_m + phase)
//
// Regressors: sin(theta_m), cos(theta_m); coefficients A cos(phase), A sin(phase).
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class EccentricLoad final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "eccentric_load"; }
  std::string_view meaning() const override {
    return "torque once per turn: unbalance under gravity, misaligned shaft";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("amplitude_Nm", amplitude_, 0, 1e4, "peak torque", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at theta_m = 0");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<EccentricLoad>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = amplitude_ * math::sin(point.theta_m + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(point.theta_m);
    columns[0] = {.T_load = s};
    columns[1] = {.T_load = c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "amplitude_Nm", .linear = true}, {.key = "phase_rad", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(amplitude_) / smallest_torque(facts, 8e-3);
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"cogging", Run::kUncoupled}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kTorqueRipple, 2},
            .period = {.in = Period::kAngle, .order = 1},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverPeriod,
            .told_by = Run::kSlowBothWays,
            .relatives = kRelatives,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "amplitude_Nm = 0.2\nphase_rad = 0.5\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTurns,
        .equation = "T_load += A sin(theta_m + phase)",
        .shows = "Order 1 in load torque and speed, at every speed with the same angle.",
        .taken_for =
            "`cogging` of order 1; `friction_ripple` of order 1 in one direction; "
            "`encoder_eccentricity`, which grows with the speed."};
    return kPortrait;
  }

 private:
  double amplitude_ = 0;
  double phase_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_eccentric_load() {
  return std::make_shared<EccentricLoad>();
}

}  // namespace twinrate

// Friction that varies over a turn: a bearing or seal that rubs more at one angle.
//
//   T_load += tanh(omega_m/omega_smooth) A sin(N theta_m + phase)
//
// It changes sign with the direction, which distinguishes it from cogging. Regressors at given N:
// tanh() sin(N theta_m), tanh() cos(N theta_m); coefficients A cos(phase), A sin(phase).
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class FrictionRipple final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "friction_ripple"; }
  std::string_view meaning() const override { return "friction that varies over a turn"; }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.integer("order", order_, 1, 2000, "periods a mechanical turn", Presence::kRequired);
    f.number("amplitude_Nm", amplitude_, 0, 1e4, "peak of the variation", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at theta_m = 0");
    f.number("smooth_rad_s", omega_smooth_, 1e-6, 1e3, "speed scale of the sign's smoothing");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<FrictionRipple>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = smooth_sign(point.omega_m, omega_smooth_) * amplitude_ *
                      math::sin(order_ * point.theta_m + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const double sign = smooth_sign(point.omega_m, omega_smooth_);
    const auto [s, c] = math::sincos(order_ * point.theta_m);
    columns[0] = {.T_load = sign * s};
    columns[1] = {.T_load = sign * c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    return {{"order", whole_orders(1, 6), false},
            {.key = "amplitude_Nm", .linear = true},
            {.key = "phase_rad", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(amplitude_) / smallest_torque(facts, 8e-3);
  }

  Traits traits() const override {
    static constexpr Reading kReadings[] = {{Reading::kAtOrderOfPolePairs, "current_offset"},
                                            {Reading::kAtTwiceThatOrder, "current_gain"}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kTorqueRipple, 1},
            .period = {.in = Period::kAngle, .order_key = "order"},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kGrid,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverPeriodByMotion,
            .told_by = Run::kSlowBothWays,
            .relatives = none,
            .readings = kReadings,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "order = 1\namplitude_Nm = 0.05\nphase_rad = 0.5\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTurns,
        .equation = "T_load += tanh(omega_m/omega_smooth) A sin(N theta_m + phase)",
        .shows = "Like cogging of order N, but its sign changes with the direction.",
        .taken_for = "`cogging` and `eccentric_load` if the drive turns in one direction only."};
    return kPortrait;
  }

 private:
  int order_ = 1;
  double amplitude_ = 0;
  double phase_ = 0;
  double omega_smooth_ = kSmoothSpeed;
};

}  // namespace

std::shared_ptr<Effect> make_friction_ripple() {
  return std::make_shared<FrictionRipple>();
}

}  // namespace twinrate

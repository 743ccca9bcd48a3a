// Eccentric encoder disc: the reading runs ahead and behind once a turn.
//
//   theta_meas = theta_m + A sin(theta_m + phase)
//
// A disc of radius r mounted e off centre has A = e/r. Regressors: sin(theta_m), cos(theta_m);
// coefficients A cos(phase), A sin(phase).
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class EncoderEccentricity final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "encoder_eccentricity"; }
  std::string_view meaning() const override { return "error of the angle reading, once per turn"; }
  int acts_on() const override { return kOnAngle; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "omega_m"}; }
  void fields(FieldVisitor& f) override {
    f.number("amplitude_rad", amplitude_, 0, 0.5, "peak error, mechanical", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at theta_m = 0");
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<EncoderEccentricity>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.theta_m = amplitude_ * math::sin(point.theta_m + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(point.theta_m);
    columns[0] = {.theta_m = s};
    columns[1] = {.theta_m = c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("amplitude_rad"), linear_key("phase_rad")};
  }
  double materiality(const DriveFacts&) const override { return amplitude_ / 2e-4; }

  Traits traits() const override {
    return {.equation = Equation::kSensing,
            .family = {Family::kAngleSensor, 1},
            .period = {.in = Period::kAngle, .order = 1},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kSlowBothWays,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "amplitude_rad = 2e-3\n",
        .signal = Portrait::kSpeed,
        .over = Portrait::kOverTurns,
        .equation = "theta_meas = theta_m + A sin(theta_m + phase)",
        .shows =
            "Order 1 in the true speed; the loop makes the measured speed smooth. The estimated "
            "load torque contains the inertia torque of this ripple, so it grows with the square "
            "of the speed.",
        .taken_for = "`eccentric_load` at one speed."};
    return kPortrait;
  }

 private:
  double amplitude_ = 0;
  double phase_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_encoder_eccentricity() {
  return std::make_shared<EncoderEccentricity>();
}

}  // namespace twinrate

// A torque that is periodic in time, or in the angle with an order that need not be whole: a
// vibration of the bench, a gear, a belt. Outside the catalogue of causes: a stop-gap that
// describes the torque without a cause.
//
//   T_load += A sin(2 pi f t + nu theta_m + phase)
//
// Regressors at given f and nu: sine and cosine; coefficients A cos(phase), A sin(phase).
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class PeriodicTorque final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "periodic_torque"; }
  std::string_view meaning() const override {
    return "torque periodic in time or in the angle, of any cause";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"t", "theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("frequency_Hz", f_, 0, 1e5, "in time; 0: none");
    f.number("order", nu_, 0, 2000, "in the angle, periods a mechanical turn; 0: none");
    f.number("amplitude_Nm", amplitude_, 0, 1e4, "peak torque", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi,
             "phase of the sine at t = 0, theta_m = 0");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<PeriodicTorque>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = amplitude_ * math::sin(angle(point) + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(angle(point));
    columns[0] = {.T_load = s};
    columns[1] = {.T_load = c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    amplitude_ = std::hypot(values[0], values[1]);
    phase_ = math::atan2(values[1], values[0]);
  }
  // The place of a found line is refined. Nothing is searched on a grid.
  std::vector<TracedKey> traced_keys() const override {
    std::vector<TracedKey> keys;
    if (f_ > 0) keys.push_back({.key = "frequency_Hz", .grid = {f_}});
    if (nu_ > 0) keys.push_back({.key = "order", .grid = {nu_}});
    return keys;
  }
  double materiality(const DriveFacts& facts) const override {
    return amplitude_ / smallest_torque(facts, 5e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kTorqueRipple, 3},
            .period = {.in = Period::kAngleOrTime,
                       .order_key = "order",
                       .frequency_key = "frequency_Hz"},
            .repeats = {.how = Repeats::kFreely},
            .place = Place::kLine,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverPeriod,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "frequency_Hz = 3\namplitude_Nm = 0.1\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTime,
        .equation = "T_load += A sin(2 pi f t + nu theta_m + phase)",
        .shows =
            "A line in the load torque that keeps its frequency when the speed changes, or one of "
            "an order that is not whole. It describes the data without a cause.",
        .taken_for = "`cogging`, if the order is whole."};
    return kPortrait;
  }

 private:
  double angle(const OperatingPoint& point) const {
    return kTwoPi * f_ * point.t + nu_ * point.theta_m;
  }

  double f_ = 0;
  double nu_ = 0;
  double amplitude_ = 0;
  double phase_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_periodic_torque() {
  return std::make_shared<PeriodicTorque>();
}

}  // namespace twinrate

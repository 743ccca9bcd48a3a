// Ripple of the DC bus, as from a rectifier. v_dc += A sin(2 pi f t + phase)
//
// The drive scales its duties by the bus voltage measured at the start of the interval, so only the
// change since then acts. Regressors at given f: sin(2 pi f t), cos(2 pi f t); coefficients A
// cos(phase), A sin(phase).
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class DcBusRipple final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "dc_bus_ripple"; }
  std::string_view meaning() const override {
    return "alternating part of the bus voltage, as of a rectifier";
  }
  int acts_on() const override { return kOnBus; }
  std::vector<std::string> signals_needed() const override { return {"t", "v_dc"}; }
  void fields(FieldVisitor& f) override {
    f.number("amplitude_V", amplitude_, 0, 1000, "peak", Presence::kRequired);
    f.number("frequency_Hz", f_, 0, 1e5,
             "of the ripple: 6 times the mains for a three-phase bridge", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at t = 0");
  }
  std::string prepare(const DriveFacts& facts) override {
    return amplitude_ < facts.v_dc ? "" : "amplitude_V is the bus voltage or more";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<DcBusRipple>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.v_dc = amplitude_ * math::sin(kTwoPi * f_ * point.t + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(kTwoPi * f_ * point.t);
    columns[0] = {.v_dc = s};
    columns[1] = {.v_dc = c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("amplitude_V"),
            linear_key("phase_rad"),
            {"frequency_Hz", {50, 100, 150, 300, 600}}};
  }
  double materiality(const DriveFacts& facts) const override {
    return amplitude_ / (3e-3 * facts.v_dc);
  }

  Traits traits() const override {
    return {.equation = Equation::kElectrical,
            .family = {Family::kBus, 0},
            .period = {.in = Period::kTime, .frequency_key = "frequency_Hz"},
            .repeats = {.how = Repeats::kByKey, .key = "frequency_Hz"},
            .place = Place::kBusLine,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "amplitude_V = 12.0\nfrequency_Hz = 300.0\n",
        .signal = Portrait::kIqTrue,
        .over = Portrait::kOverTime,
        .equation =
            "v_dc += A sin(2 pi f t + phase); the applied voltage is duty v_dc(t), the duty was "
            "chosen for v_dc(t_k)",
        .shows =
            "The measured bus voltage, and a little in u and i: the modulator corrects with the "
            "sample at the start of the interval. The effect has a frequency, not an order: here "
            "300 Hz at one turn per second. A trace finds it in v_dc.",
        .taken_for =
            "A mechanical effect of the same frequency at one speed; it moves in the order "
            "spectrum when the speed changes.",
        .orders = 360};
    return kPortrait;
  }

 private:
  double amplitude_ = 0;
  double f_ = 0;
  double phase_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_dc_bus_ripple() {
  return std::make_shared<DcBusRipple>();
}

}  // namespace twinrate

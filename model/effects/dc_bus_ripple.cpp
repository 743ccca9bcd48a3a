// Ripple of the DC bus, as a rectifier makes it.  v_dc += A sin(2 pi f t + phase)
//
// The drive scales its duties by the bus voltage it measured at the start of the interval, so what
// acts is the change since then. Regressors at given f: sin(2 pi f t), cos(2 pi f t); coefficients
// A cos(phase), A sin(phase).
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class DcBusRipple final : public Effect {
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
    return {.v_dc = amplitude_ * std::sin(kTwoPi * f_ * point.t + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.v_dc = std::sin(kTwoPi * f_ * point.t)};
    columns[1] = {.v_dc = std::cos(kTwoPi * f_ * point.t)};
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

// Cogging: the magnets pull on the slots.  T_load += A sin(N theta_m + phase)       (Niewiara (9),
// one order)
//
// Regressors at a given order N: sin(N theta_m), cos(N theta_m); coefficients A cos(phase), A
// sin(phase).
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class Cogging final : public Effect {
 public:
  std::string_view kind() const override { return "cogging"; }
  std::string_view meaning() const override { return "torque periodic in the mechanical angle"; }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.integer("order", order_, 1, 2000, "periods a mechanical turn", Presence::kRequired);
    f.number("amplitude_Nm", amplitude_, 0, 1e4, "peak torque", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at theta_m = 0");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Cogging>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = amplitude_ * std::sin(order_ * point.theta_m + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = std::sin(order_ * point.theta_m)};
    columns[1] = {.T_load = std::cos(order_ * point.theta_m)};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = amplitude_ * std::cos(phase_);
    values[1] = amplitude_ * std::sin(phase_);
  }

 private:
  int order_ = 1;
  double amplitude_ = 0;
  double phase_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_cogging() {
  return std::make_shared<Cogging>();
}

}  // namespace twinrate

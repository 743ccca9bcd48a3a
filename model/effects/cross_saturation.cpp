// Cross saturation: the current of one axis takes flux from the other.
//
//   coenergy W' = -3/2 c/2 i_d i_q^2  =>  psi_d -= c/2 i_q^2,  psi_q -= c i_d i_q
//
// Both from one coenergy, so d psi_d/d i_q = d psi_q/d i_d and no energy comes from nowhere; the
// lowest such term that treats both signs of i_q alike. It weakens the magnets at load, and L_q
// where i_d strengthens the field. Regressor: -[i_q^2/2, i_d i_q]; coefficient c.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class CrossSaturation final : public Effect {
 public:
  std::string_view kind() const override { return "cross_saturation"; }
  std::string_view meaning() const override {
    return "flux of one axis that the current of the other takes away";
  }
  int acts_on() const override { return kOnFlux; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("coefficient_H_A", c_, -10, 10, "flux lost along q for an ampere of each axis",
             Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<CrossSaturation>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.psi_dq = c_ * column(point)};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.psi_dq = column(point)};
  }
  void coefficients(std::span<double> values) const override { values[0] = c_; }
  void set_coefficients(std::span<const double> values) override { c_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("coefficient_H_A")}; }
  double materiality(const DriveFacts& facts) const override {
    // At rated current along q.
    return 0.5 * std::abs(c_) * rated_current(facts) / (0.015 * facts.machine.L_q);
  }

 private:
  static Vec2 column(const OperatingPoint& point) {
    const double i_d = point.i_dq[0], i_q = point.i_dq[1];
    return {-0.5 * i_q * i_q, -i_d * i_q};
  }

  double c_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_cross_saturation() {
  return std::make_shared<CrossSaturation>();
}

}  // namespace twinrate

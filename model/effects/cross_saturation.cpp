// Cross saturation: the current of one axis reduces the flux of the other.
//
//   coenergy W' = -3/2 (c i_d + c_2 i_d^2) G(i_q)
//   =>  psi_d -= (c + 2 c_2 i_d) G(i_q),  psi_q -= (c i_d + c_2 i_d^2) G'(i_q)
//   G = i_q^2/2;  with a current I_c above which it levels off  G = I_c^2 ln cosh(i_q/I_c)
//
// Both follow from one coenergy, so d psi_d/d i_q = d psi_q/d i_d and energy is conserved; c is the
// lowest such term that is even in i_q. It weakens the magnets at load, and L_q if i_d strengthens
// the field; c_2 does so for both signs of i_d. Regressors: [G, i_d G'] and, if c_2 is not 0, [2
// i_d G, i_d^2 G'], with a minus; coefficients c, c_2.
#include <cmath>
#include <numbers>

#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class CrossSaturation final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "cross_saturation"; }
  std::string_view meaning() const override {
    return "reduction of the flux of one axis by the current of the other";
  }
  int acts_on() const override { return kOnFlux; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("coefficient_H_A", c_, -10, 10, "flux lost along q for an ampere of each axis",
             Presence::kRequired);
    f.number("second_H_A2", c_2_, -10, 10, "the same for the square of i_d");
    f.number("current_A", I_c_, 0, 1e6, "i_q at which it fades; 0: it does not");
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<CrossSaturation>(*this);
  }
  Contribution at(const OperatingPoint& point) const override {
    return {.psi_dq = c_ * first(point) + c_2_ * second(point)};
  }
  int regressor_count() const override { return c_2_ != 0 ? 2 : 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.psi_dq = first(point)};
    if (c_2_ != 0) columns[1] = {.psi_dq = second(point)};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = c_;
    if (c_2_ != 0) values[1] = c_2_;
  }
  void set_coefficients(std::span<const double> values) override {
    c_ = values[0];
    if (c_2_ != 0) c_2_ = values[1];
  }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("coefficient_H_A")}; }
  double materiality(const DriveFacts& facts) const override {
    // At rated current along q.
    return 0.5 * std::abs(c_) * rated_current(facts) / (0.015 * facts.machine.L_q);
  }

  Traits traits() const override {
    // At rated current an axis has not lost twice its inductance.
    static constexpr Bound kBounds[] = {{"coefficient_H_A", 2, Bound::kInductanceAtRated}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kFlux, 3},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kFluxOverOtherCurrent,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = kBounds,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "coefficient_H_A = 1e-3\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTime,
        .equation = "psi_d -= c/2 i_q^2, psi_q -= c i_d i_q",
        .shows =
            "Less torque per ampere under load: the estimated load torque, computed with the "
            "declared flux, is 0.6 % too large here, and the EMF along q is too small. Both grow "
            "with the square of i_q, so a light load does not show the effect. L_q changes with "
            "i_d.",
        .taken_for = "`flux_linkage` at one load; `saturation` of the d axis."};
    return kPortrait;
  }

 private:
  double G(double i_q) const {
    if (I_c_ == 0) return 0.5 * i_q * i_q;
    // ln cosh x = |x| + ln(1 + exp(-2 |x|)) - ln 2
    const double x = std::abs(i_q) / I_c_;
    return I_c_ * I_c_ * (x + math::log1p(math::exp(-2 * x)) - std::numbers::ln2);
  }
  double G_slope(double i_q) const { return I_c_ == 0 ? i_q : I_c_ * math::tanh(i_q / I_c_); }
  Vec2 first(const OperatingPoint& point) const {
    return {-G(point.i_dq[1]), -point.i_dq[0] * G_slope(point.i_dq[1])};
  }
  Vec2 second(const OperatingPoint& point) const {
    const double i_d = point.i_dq[0];
    return {-2 * i_d * G(point.i_dq[1]), -i_d * i_d * G_slope(point.i_dq[1])};
  }

  double c_ = 0, c_2_ = 0;
  double I_c_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_cross_saturation() {
  return std::make_shared<CrossSaturation>();
}

}  // namespace twinrate

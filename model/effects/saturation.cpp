// Saturation: iron with much flux adds less flux for the next ampere.
//
//   psi_q   = L_q i_q f(|i_q|/I_s)                     likewise along d
//   psi_dq += [0, psi_q - L_q i_q]
//
//   form   rational   f(x) = 1/(1 + x)
//          square     f(x) = 1/(1 + x^2) up to x = 0.8, then along the tangent (the formula falls
//                     from x = 1 on, which no iron does)
//          tanh       f(x) = tanh(x)/x
//
// share_q, share_d: the part of L that saturates; the remainder is constant. May be above 1 if
// machine.L_q is not the inductance without current. I_s = 0: no saturation. The d axis saturates
// if current_d_A is given, by its current alone.
//
// Regressors, one for each axis that saturates (q first), and coefficient c:
//
//   rational   L i (f - 1)/c    c = 1/I_s       at c = 0: -L i |i|
//   square     L i (f - 1)/c    c = 1/I_s^2     at c = 0: -L i^3
//   tanh       L i (f - 1)/c    c = 1/I_s^2     at c = 0: -L i^3/3
//
// So a regression can start from no saturation; each further round at the I_s found comes closer.
// set_coefficients takes c <= 0, more inductance at more current, as no saturation.
#include <algorithm>

#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

constexpr const char* kFormNames[] = {"rational", "square", "tanh"};
enum Form : int { kRational = 0, kSquare = 1, kTanh = 2 };

// psi/(L I_s) less x = |i|/I_s: the loss by saturation, as a positive number.
double lost(Form form, double x) {
  constexpr double kEnd = 0.8, kTop = kEnd / (1 + kEnd * kEnd);
  constexpr double kSlope = (1 - kEnd * kEnd) / ((1 + kEnd * kEnd) * (1 + kEnd * kEnd));
  if (form == kRational) return x * x / (1 + x);
  if (form == kSquare) return x < kEnd ? x * x * x / (1 + x * x) : x - kTop - kSlope * (x - kEnd);
  return x < 1e-2 ? x * x * x / 3 * (1 - 0.4 * x * x) : x - math::tanh(x);
}

// One axis: the missing flux is coefficient() times regressor().
struct Axis {
  double I_s = 0;  // A
  double share = 1;
  double L = 0;  // H, the saturating part

  double coefficient(Form form) const {
    if (I_s == 0) return 0;
    return form == kRational ? 1 / I_s : 1 / (I_s * I_s);
  }
  void set_coefficient(Form form, double c) {
    I_s = c <= 0 ? 0 : form == kRational ? 1 / c : 1 / std::sqrt(c);
  }
  double regressor(Form form, double i) const {
    const double a = std::abs(i);
    if (I_s == 0) return -L * i * (form == kRational ? a : form == kSquare ? a * a : a * a / 3);
    const double psi = -L * I_s * lost(form, a / I_s) / coefficient(form);
    return i < 0 ? -psi : psi;
  }
  double psi(Form form, double i) const { return coefficient(form) * regressor(form, i); }
};

class Saturation final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "saturation"; }
  std::string_view meaning() const override { return "inductance that falls with its current"; }
  int acts_on() const override { return kOnFlux; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.choice("form", form_, kFormNames, "how the inductance falls");
    f.number("current_q_A", q_.I_s, 0, 1e6, "scale I_s along q; 0: none", Presence::kRequired);
    f.number("current_d_A", d_.I_s, 0, 1e6, "the same along d");
    f.number("share_q", q_.share, 0, 10, "of L_q, what saturates");
    f.number("share_d", d_.share, 0, 10, "the same along d");
  }
  std::string prepare(const DriveFacts& facts) override {
    d_.L = d_.share * facts.machine.L_d;
    q_.L = q_.share * facts.machine.L_q;
    return "";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Saturation>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.psi_dq = Vec2(d_.psi(form_, point.i_dq[0]), q_.psi(form_, point.i_dq[1]))};
  }
  int regressor_count() const override { return d_.I_s > 0 ? 2 : 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.psi_dq = Vec2(0, q_.regressor(form_, point.i_dq[1]))};
    if (d_.I_s > 0) columns[1] = {.psi_dq = Vec2(d_.regressor(form_, point.i_dq[0]), 0)};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = q_.coefficient(form_);
    if (d_.I_s > 0) values[1] = d_.coefficient(form_);
  }
  void set_coefficients(std::span<const double> values) override {
    q_.set_coefficient(form_, values[0]);
    if (d_.I_s > 0) d_.set_coefficient(form_, values[1]);
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("current_q_A"), {"form", {kRational, kSquare, kTanh}, false}};
  }
  double materiality(const DriveFacts& facts) const override {
    const double i = rated_current(facts);
    return std::max(std::abs(d_.psi(form_, i)) / facts.machine.L_d,
                    std::abs(q_.psi(form_, i)) / facts.machine.L_q) /
           (0.015 * i);
  }

  Traits traits() const override {
    return {.equation = Equation::kElectrical,
            .family = {Family::kFlux, 2},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kGrid,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kFluxOverItsCurrent,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "form = \"rational\"\ncurrent_q_A = 8.0\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTime,
        .equation =
            "psi_q = L_q i_q f(|i_q|/I_s); f(x) = 1/(1 + x) rational, 1/(1 + x^2) square (along "
            "its tangent beyond x = 0.8), tanh(x)/x tanh; likewise along d where current_d_A is "
            "given",
        .shows =
            "Voltage across the current at speed, here along d, that grows less than the current; "
            "currents that respond faster under load.",
        .taken_for = "`inductance` at one load; `cross_saturation`."};
    return kPortrait;
  }

 private:
  Form form_ = kRational;
  Axis d_, q_;
};

}  // namespace

std::shared_ptr<Effect> make_saturation() {
  return std::make_shared<Saturation>();
}

}  // namespace twinrate

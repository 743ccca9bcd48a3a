#include "trace/position_effects.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"

namespace twinrate {

const char* const kOrderOfTorque = "cogging";
const char* const kOrderOfFriction = "friction_ripple";
const char* const kMeanFriction = "coulomb_friction";
namespace {

struct Evidence {
  double z = 0;        // size over its standard deviation
  double freedom = 1;  // parameters: 1 or 2
  std::size_t rows = 0;
  double without = kNoError, with = kNoError;  // held-out errors
};

TracedEffect traced(std::shared_ptr<Effect> effect, std::string equation,
                    const std::map<std::string, double>& sigma, const Evidence& evidence,
                    const DriveFacts& facts) {
  effect->prepare(facts);
  TracedEffect e;
  e.parameters = traced_parameters(*effect, sigma);
  e.equation = std::move(equation);
  const double ratio = evidence.with / evidence.without;
  e.held_out_gain = 1 - ratio * ratio;
  const double z2 = evidence.z * evidence.z;
  e.delta_bic =
      -z2 + evidence.freedom * std::log(std::max<double>(2, static_cast<double>(evidence.rows)));
  e.p_value = evidence.freedom > 1 ? std::exp(-z2 / 2) : std::erfc(evidence.z / std::sqrt(2.0));
  e.materiality = effect->tracing().materiality(facts);
  e.effect = std::move(effect);
  return e;
}

std::shared_ptr<Effect> sine_effect(const char* kind, const Harmonic& h) {
  auto effect = make_effect(kind);
  set_key(*effect, "order", h.order);
  set_key(*effect, "amplitude_Nm", h.amplitude);
  set_key(*effect, "phase_rad", h.phase);
  return effect;
}

// Effects that are constant in stator axes, or that occur with the poles, have the same orders.
std::vector<std::string> aliases_of_order(const Effect& effect, int order, int n_p) {
  if (order == n_p) return kinds_read(effect, Traits::Reading::kAtOrderOfPolePairs);
  if (order == 2 * n_p) return kinds_read(effect, Traits::Reading::kAtTwiceThatOrder);
  return {};
}

std::shared_ptr<Effect> lag_effect(int signal, double lag, double delay_share) {
  auto effect = make_of(Traits::Family::kLag);
  set_key(*effect, "signal", signal);
  set_key(*effect, "form", delay_share >= 1 ? 0 : 1);
  set_key(*effect, "lag_s", lag);
  set_key(*effect, "delay_share", delay_share);
  return effect;
}

bool tells_friction(const Found& f) {
  return f.sigma_T_C() > 0 && f.T_C() > 5 * f.sigma_T_C();
}
bool tells_inertia(const Found& f) {
  if (f.spin.gain <= 0) return false;
  const double change = std::abs(f.J() - f.machine.J);
  return change >= 0.03 * f.machine.J && change >= 5 * f.J() * f.spin.sigma_gain / f.spin.gain;
}
bool tells_speed_lag(const Found& f) {
  return f.speed_lag.lag() > 0 && f.speed_lag.lag() > 5 * f.speed_lag.sigma;
}

}  // namespace

const std::vector<PositionClaim>& position_claims() {
  const auto cogs = [](const Found& f) { return !f.holding.cogging.empty(); };
  const auto ripples = [](const Found& f) { return !f.holding.friction_ripple.empty(); };
  static const std::vector<PositionClaim> claims = {
      {"cogging", cogs, cogs, [](Found& f) { f.holding.cogging.clear(); }},
      {"friction_ripple", ripples, ripples, [](Found& f) { f.holding.friction_ripple.clear(); }},
      {"coulomb_friction", [](const Found& f) { return f.T_C() != 0; }, tells_friction,
       [](Found& f) { f.holding.T_C = f.spin.T_C = 0; }},
      {"inertia", [](const Found& f) { return f.spin.gain > 0; }, tells_inertia,
       [](Found& f) { f.spin.gain = 0; }},
      {std::string(make_of(Traits::Family::kLag)->kind()),
       [](const Found& f) { return f.speed_lag.lag() > 0; }, tells_speed_lag,
       [](Found& f) { f.speed_lag = {}; }},
  };
  return claims;
}

void drop_excluded(const Considered& considered, Found& found) {
  for (const PositionClaim& claim : position_claims())
    if (!considered(claim.kind)) claim.drop(found);
  if (considered(make_of(Traits::Family::kLag)->kind())) return;
  found.holding.lag = found.holding.sigma_lag = found.holding.lag_share = 0;
  found.lag_is_of_current = false;
}

void add_periodic(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const double with = judge.error(found, found.model());
  const auto add = [&](const char* kind, std::vector<Harmonic> HoldingTorque::*list) {
    for (std::size_t i = 0; i < (found.holding.*list).size(); ++i) {
      const Harmonic& h = (found.holding.*list)[i];
      HoldingTorque less = found.holding;
      (less.*list).erase((less.*list).begin() + static_cast<std::ptrdiff_t>(i));
      MotionModel model = found.model();
      model.holding = &less;
      r.effects.push_back(
          traced(sine_effect(kind, h), "mechanical",
                 {{"amplitude_Nm", h.sigma_amplitude}, {"phase_rad", h.sigma_phase}},
                 {.z = h.amplitude / h.sigma_amplitude,
                  .freedom = 2,
                  .rows = found.holding.rows,
                  .without = judge.error(found, model),
                  .with = with},
                 facts));
      TracedEffect& e = r.effects.back();
      e.aliases = aliases_of_order(*e.effect, h.order, facts.machine.n_p);
    }
  };
  add("cogging", &HoldingTorque::cogging);
  add("friction_ripple", &HoldingTorque::friction_ripple);
}

void add_friction(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const double T_C = found.T_C(), sigma = found.sigma_T_C();
  if (tells_friction(found)) {
    auto effect = make_effect("coulomb_friction");
    set_key(*effect, "torque_Nm", T_C);
    HoldingTorque less = found.holding;
    less.T_C = 0;
    MotionModel model = found.model();
    model.holding = &less;
    model.T_C = 0;
    r.effects.push_back(traced(effect, "mechanical", {{"torque_Nm", sigma}},
                               {.z = T_C / sigma,
                                .rows = found.holding.rows + found.spin.windows,
                                .without = judge.error(found, model),
                                .with = judge.error(found, found.model())},
                               facts));
    if (found.friction_slope.falls()) {
      r.effects.back().aliases = {"stribeck_friction"};
      r.ambiguous.push_back({{"coulomb_friction", "stribeck_friction"},
                             fmt::format("the friction falls by {:.0f} % up to the fastest rows",
                                         -100 * found.friction_slope.change),
                             "constant speeds from creeping to the fastest, in both directions"});
    }
  }
  if (!found.at_rest.empty() && !found.holding.both_directions)
    r.ambiguous.push_back(
        {{"coulomb_friction", "constant_load", "current_offset"},
         "the rotor turns in one direction only: friction is a constant current, like an offset",
         "the same sweep in the other direction: friction changes its sign, an offset does not"});
  const double drift = found.spin.T_C - T_C;
  if (found.holding.both_directions && found.spin.sigma_T_C > 0 &&
      std::abs(drift) > 5 * std::hypot(found.spin.sigma_T_C, sigma))
    r.ambiguous.push_back(
        {{"viscous_friction", "stribeck_friction", "coulomb_friction"},
         fmt::format(
             "friction is {:.2f} mNm at rest and {:.2f} mNm + {:.3g} uNms omega_m in motion; "
             "the data do not show the transition",
             1e3 * T_C, 1e3 * found.spin.T_C, 1e6 * found.spin.B),
         "constant speeds from creeping to the fastest, in both directions"});
}

void add_inertia(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  if (found.spin.gain <= 0) return;
  const double J = found.J(), sigma = J * found.spin.sigma_gain / found.spin.gain;
  r.identifiable.push_back(fmt::format(
      "K_t/J = {:.0f} +- {:.0f} rad/s^2 A; with the declared K_t J = {:.3g} kgm2 (declared {:.3g})",
      found.gain(), found.spin.sigma_gain, J, facts.machine.J));
  r.constants.push_back({"J", "kgm2", J, sigma, ""});
  const double change = J - facts.machine.J;
  if (!tells_inertia(found)) return;
  auto effect = make_of(Traits::Family::kInertia);
  const std::string key = numeric_keys(*effect).front().key;
  if (!set_key(*effect, key, change)) return;
  MotionModel declared = found.model();
  declared.gain = facts.machine.torque_constant() / facts.machine.J;
  r.effects.push_back(traced(effect, "mechanical", {{key, sigma}},
                             {.z = std::abs(change) / sigma,
                              .rows = found.spin.windows,
                              .without = judge.error(found, declared),
                              .with = judge.error(found, found.model())},
                             facts));
  TracedEffect& e = r.effects.back();
  e.aliases = kinds_read(*e.effect, Traits::Reading::kWithoutVoltage);
}

void add_lags(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const SpeedLag& s = found.speed_lag;
  if (tells_speed_lag(found)) {
    MotionModel model = found.model();
    model.speed_lag = {};
    r.effects.push_back(traced(lag_effect(SamplingFacts::kSpeed, s.lag(), s.delay / s.lag()),
                               "sensing", {{"lag_s", s.sigma}},
                               {.z = s.lag() / s.sigma,
                                .rows = found.in_motion.front()->size(),
                                .without = judge.error(found, model),
                                .with = judge.error(found, found.model())},
                               facts));
  }
  if (!found.lag_is_of_current) return;
  HoldingTorque less = found.holding;
  less.lag = 0;
  MotionModel model = found.model();
  model.holding = &less;
  r.effects.push_back(traced(lag_effect(SamplingFacts::kCurrent, found.holding.lag, 0), "sensing",
                             {{"lag_s", found.holding.sigma_lag}},
                             {.z = found.holding.lag / std::max(found.holding.sigma_lag, 1e-12),
                              .rows = found.holding.rows,
                              .without = judge.error(found, model),
                              .with = judge.error(found, found.model())},
                             facts));
  // Far too long for a current loop to tolerate: a filter of the logged value.
  r.effects.back().only_in_log = true;
}

namespace {

// A change of R_s is claimed if it predicts rows that no fit has seen better than the declared R_s,
// beyond chance: R of those rows alone is closer to it, and far from the declared R_s.
void add_resistance(const Found& found, const DriveFacts& facts, TraceResult& r) {
  constexpr double kSigmas = 3;
  const WindingVoltage &fitted = found.voltage_fitted, &unseen = found.voltage_unseen;
  const double R_s = facts.machine.R_s, change = fitted.R - R_s;
  if (fitted.sigma_R <= 0 || std::abs(change) <= 0.02 * R_s ||
      std::abs(change) <= kSigmas * fitted.sigma_R)
    return;
  auto effect = make_of(Traits::Family::kResistance);
  const double away = unseen.sigma_R > 0 ? (unseen.R - R_s) / unseen.sigma_R : 0;
  if (std::abs(away) <= kSigmas || std::abs(unseen.R - fitted.R) >= std::abs(unseen.R - R_s)) {
    r.refused.push_back(
        {.kind = std::string(effect->kind()),
         .rule = "transfer",
         .number = away,
         .text = unseen.sigma_R > 0
                     ? fmt::format("R_s is {:.3f} +- {:.3f} Ohm in the held-out rows and {:.3f} +- "
                                   "{:.3f} Ohm in the fitted rows, declared {:.3f}",
                                   unseen.R, unseen.sigma_R, fitted.R, fitted.sigma_R, R_s)
                     : std::string("no held-out row has a voltage")});
    return;
  }
  set_key(*effect, "change_Ohm", change);
  r.effects.push_back(traced(effect, "electrical", {{"change_Ohm", fitted.sigma_R}},
                             {.z = std::abs(change) / fitted.sigma_R, .rows = fitted.rows}, facts));
}

}  // namespace

void add_voltage(const Found& found, const DriveFacts& facts, const Considered& considered,
                 TraceResult& r) {
  const WindingVoltage& v = found.voltage;
  if (v.sigma_R <= 0) return;
  const double R_s = facts.machine.R_s;
  std::string text = fmt::format("R_s = {:.3f} +- {:.3f} Ohm", v.R, v.sigma_R);
  if (v.R_at_rest > 0 && v.R_in_motion > 0)
    text += fmt::format(" (at rest {:.3f}, in motion {:.3f})", v.R_at_rest, v.R_in_motion);
  text += fmt::format(", declared {:.3f}", R_s);
  if (v.R_by_logged_speed > 0 && found.speed_lag.lag() > 0)
    text += fmt::format("; the logged speed, {:.2f} ms late, would give {:.3f}",
                        1e3 * found.speed_lag.lag(), v.R_by_logged_speed);
  r.identifiable.push_back(text);
  if (v.K_e > 0) r.constants.push_back({"psi_f", "Wb", v.K_e / facts.machine.n_p, {}, ""});
  if (v.K_e > 0)
    r.identifiable.push_back(fmt::format("psi_f = {:.4g} Wb from the EMF, declared {:.4g}",
                                         v.K_e / facts.machine.n_p, facts.machine.psi_f));
  r.constants.push_back({"R_s", "Ohm", v.R, v.sigma_R, ""});
  if (considered(make_of(Traits::Family::kResistance)->kind())) add_resistance(found, facts, r);
  const int n_p = facts.machine.n_p;
  for (const Harmonic& h : v.ripple) {
    const std::string why = fmt::format(
        "u_q at rest ripples {} times a turn ({} an electrical turn) by {:.1f} mV", h.order,
        h.order % n_p == 0 ? fmt::format("{}", h.order / n_p)
                           : fmt::format("{:.3g}", static_cast<double>(h.order) / n_p),
        1e3 * h.amplitude);
    const char* separate = "the same sweep with the phase currents and both voltages logged";
    if (h.order == n_p)
      r.ambiguous.push_back({{"inverter_offset", "current_offset"},
                             why + ": an offset that is constant in stator axes, of the inverter "
                                   "or of the current sensors",
                             separate});
    else if (h.order == 2 * n_p)
      r.ambiguous.push_back({{"phase_asymmetry", "current_gain"}, why, separate});
    else if (h.order % (3 * n_p) == 0)
      r.ambiguous.push_back({{"dead_time", "inverter_drop", "flux_harmonics"}, why, separate});
    else
      r.unexplained.push_back({.regressor = "theta_m",
                               .share = h.amplitude * h.amplitude / 2 /
                                        std::max(v.rest_declared * v.rest_declared, 1e-300),
                               .equation = "electrical",
                               .order = static_cast<double>(h.order),
                               .text = why});
  }
  EquationError e{.unit = "V", .before = {v.rest_declared, kNoError}, .after = {v.rest, kNoError}};
  e.no_change = e.noise_floor = e.whiteness_p_value = kNoError;
  e.rows = v.rows;
  r.electrical = e;
}

}  // namespace twinrate

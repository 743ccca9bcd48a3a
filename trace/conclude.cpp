#include "trace/conclude.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "trace/correction.hpp"
#include "trace/effect_view.hpp"
#include "trace/keys.hpp"
#include "trace/rest.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

constexpr double kAliasGain = 15;     // score: nearer than this, two kinds explain the same
constexpr double kAliasShare = 0.02;  // or of the gain itself
constexpr double kBlind = 4;          // sigmas a smallest effect must have to be seen

std::string equation_of(const Effect& effect) {
  const int acts = effect.acts_on();
  if (acts & (kOnCurrents | kOnAngle | kOnSpeed))
    return effect.kind() == "iron_loss" ? "electrical" : "sensing";
  if (acts == 0) return "sensing";
  return acts & (kOnVoltage | kOnFlux | kOnBus) ? "electrical" : "mechanical";
}

// Key without and with its unit: "amplitude_Nm".
std::pair<std::string, std::string> split(const std::string& key) {
  static const char* const kUnits[] = {"Nm_rad", "Nms_rad", "Nms2", "Nms", "Nm", "rad_s",
                                       "rad",    "kgm2",    "Ohm",  "H_A", "Hz", "Wb",
                                       "A",      "V",       "H",    "s"};
  for (const char* unit : kUnits) {
    const std::string tail = std::string("_") + unit;
    if (key.size() > tail.size() && key.ends_with(tail))
      return {key.substr(0, key.size() - tail.size()), unit};
  }
  return {key, key == "order" ? "per_rev" : "1"};
}

// The larger of the covariances of a white rest and of one that is not.
Eigen::MatrixXd covariance(const Fitter& fitter, const Fit& fit) {
  const double N = static_cast<double>(fitter.training().count(fit.y));
  const Eigen::MatrixXd white = fit.rss / N * fit.covariance;
  const Eigen::ArrayXd ratio =
      fitter.robust_covariance(fit).diagonal().array() / white.diagonal().array().max(1e-300);
  const Eigen::VectorXd factor = ratio.max(1).sqrt();
  return factor.asDiagonal() * white * factor.asDiagonal();
}

// Standard deviations of the keys of member m, from the covariance of the free parameters.
std::map<std::string, double> sigmas(const Fit& fit, const Eigen::MatrixXd& covariance,
                                     std::size_t m) {
  std::vector<Eigen::Index> free;
  for (std::size_t p = 0; p < fit.free.size(); ++p)
    if (fit.free[p].member == m) free.push_back(static_cast<Eigen::Index>(p));
  std::map<std::string, double> out;
  const Effect& effect = *fit.members[m];
  const auto regressors = static_cast<std::size_t>(effect.regressor_count());
  std::vector<double> c(regressors);
  effect.coefficients(c);
  for (const NumericKey& key : numeric_keys(effect)) {
    Eigen::VectorXd slope = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i) {
      const FreeParameter& p = fit.free[static_cast<std::size_t>(free[i])];
      if (p.coefficient < 0) {
        slope[static_cast<Eigen::Index>(i)] = p.key == key.key;
        continue;
      }
      const auto moved = effect.clone();
      const double sigma = std::sqrt(std::max(0.0, covariance(free[i], free[i])));
      const double h =
          std::max(1e-6 * std::abs(c[static_cast<std::size_t>(p.coefficient)]), 1e-3 * sigma);
      if (h == 0) continue;
      std::vector<double> shifted = c;
      shifted[static_cast<std::size_t>(p.coefficient)] += h;
      moved->set_coefficients(shifted);
      double change = get_key(*moved, key.key) - key.value;
      if (key.key.ends_with("_rad") && std::abs(change) > kPi)
        change -= std::copysign(kTwoPi, change);
      slope[static_cast<Eigen::Index>(i)] = change / h;
    }
    double variance = 0;
    for (std::size_t i = 0; i < free.size(); ++i)
      for (std::size_t j = 0; j < free.size(); ++j)
        variance += slope[static_cast<Eigen::Index>(i)] * slope[static_cast<Eigen::Index>(j)] *
                    covariance(free[i], free[j]);
    if (variance > 0) out[key.key] = std::sqrt(variance);
  }
  return out;
}

std::vector<TracedParameter> parameters_of(const Fit& fit, const Eigen::MatrixXd& covariance,
                                           std::size_t m) {
  std::vector<TracedParameter> list;
  const auto sigma = sigmas(fit, covariance, m);
  for (const NumericKey& key : numeric_keys(*fit.members[m])) {
    const auto [name, unit] = split(key.key);
    TracedParameter p{
        .name = name, .unit = unit, .value = key.value, .sigma = {}, .text = key.text};
    if (const auto found = sigma.find(key.key); found != sigma.end()) p.sigma = found->second;
    list.push_back(std::move(p));
  }
  return list;
}

bool near(double a, double b) {
  return a > b - std::max(kAliasGain, kAliasShare * b);
}

TracedEffect traced(const Fitter& fitter, const Fit& fit, const Selected& s, std::size_t m) {
  const Rows& rows = fitter.training();
  const double N = static_cast<double>(rows.count(fit.y));
  const Effect& effect = *fit.members[m];
  TracedEffect e{.effect = fit.members[m], .equation = equation_of(effect)};
  e.parameters = parameters_of(fit, covariance(fitter, fit), m);
  e.held_out_gain = s.held_out_gain;
  e.delta_bic = -s.score_gain;
  const double k = std::max(1, effect.regressor_count());
  e.p_value = chi_square_tail(N * (s.without.rss / fit.rss - 1), k);
  e.materiality = effect.materiality(fitter.chain().equations().facts());
  for (const Alternative& a : s.alternatives)
    if (a.why == "explains less" && near(a.score_gain, s.score_gain)) e.aliases.push_back(a.kind);
  return e;
}

double rms(const Eigen::VectorXd& x, const Runs& runs, bool held_out) {
  double sum = 0, count = 0;
  for (Eigen::Index n = 0; n < x.size(); ++n)
    if ((runs.held_out[static_cast<std::size_t>(n)] != 0) == held_out) sum += x[n] * x[n], ++count;
  return count > 0 ? std::sqrt(sum / count) : 0;
}

ErrorPair rms_pair(const Eigen::VectorXd& x, const Runs& runs) {
  return {rms(x, runs, false), rms(x, runs, true)};
}

ErrorPair both_axes(const Sampled& y, const Runs& runs) {
  const ErrorPair d = rms_pair(y.d, runs), q = rms_pair(y.q, runs);
  return {std::sqrt(0.5 * (d.train * d.train + q.train * q.train)),
          std::sqrt(0.5 * (d.held_out * d.held_out + q.held_out * q.held_out))};
}

// What the equation balances: J omega_m', and L di/dt in rotor axes, as the tracer samples them.
double no_change_torque(const Fitter& fitter) {
  const Equations& e = fitter.chain().equations();
  const Record& r = e.record();
  std::vector<double> x(r.size(), 0.0);
  for (std::size_t k = 1; k + 1 < r.size(); ++k)
    x[k] = e.facts().machine.J * (r.theta_m[k + 1] - 2 * r.theta_m[k] + r.theta_m[k - 1]) /
           (r.T_s * r.T_s);
  const Runs& runs = fitter.chain().sampler().torque();
  const Eigen::VectorXd y = fitter.chain().sampler()(x, runs);
  return std::sqrt(y.squaredNorm() / std::max<double>(1, static_cast<double>(y.size())));
}

double no_change_voltage(const Fitter& fitter) {
  const Equations& e = fitter.chain().equations();
  const Record& r = e.record();
  std::vector<double> d(r.size(), 0.0), q(r.size(), 0.0);
  const auto& p = e.points();
  for (std::size_t k = 0; k + 1 < r.size(); ++k) {
    d[k] = e.facts().machine.L_d * (p[k + 1].i_dq[0] - p[k].i_dq[0]) / r.T_s;
    q[k] = e.facts().machine.L_q * (p[k + 1].i_dq[1] - p[k].i_dq[1]) / r.T_s;
  }
  const Sampler& sampler = fitter.chain().sampler();
  const Eigen::VectorXd y_d = sampler(d, sampler.electrical()),
                        y_q = sampler(q, sampler.electrical());
  return std::sqrt(0.5 * (y_d.squaredNorm() + y_q.squaredNorm()) /
                   std::max<double>(1, static_cast<double>(y_d.size())));
}

TraceSeries series(const Fitter& fitter, const Runs& runs, const Eigen::VectorXd& before,
                   const Eigen::VectorXd& after) {
  TraceSeries s;
  const Equations& e = fitter.chain().equations();
  for (std::size_t n = 0; n < runs.row.size(); ++n) {
    const OperatingPoint& p = e.points()[runs.row[n]];
    s.t.push_back(p.t);
    s.theta_m.push_back(p.theta_m);
    s.omega_m.push_back(p.omega_m);
    s.i_d.push_back(p.i_dq[0]);
    s.i_q.push_back(p.i_dq[1]);
    s.before.push_back(before[static_cast<Eigen::Index>(n)]);
    s.after.push_back(after[static_cast<Eigen::Index>(n)]);
    s.held_out.push_back(runs.held_out[n]);
  }
  s.rate_Hz = 1 / (e.record().T_s * fitter.chain().sampler().decimation());
  return s;
}

void errors(const Fitter& fitter, const Fit& fit, TraceResult& r) {
  const Chain& chain = fitter.chain();
  const Sampler& sampler = chain.sampler();
  const Sampled before = chain.residual({}), after = chain.residual(fit.effects());
  const Sampled white = chain.whitened(after);
  r.horizon_s = chain.equations().record().T_s * sampler.decimation();
  if (before.d.size()) {
    EquationError e{.unit = "V",
                    .before = both_axes(before, sampler.electrical()),
                    .after = both_axes(after, sampler.electrical())};
    e.no_change = no_change_voltage(fitter);
    e.noise_floor = std::hypot(chain.noise().d.rms(), chain.noise().q.rms()) / std::sqrt(2.0);
    e.whiteness_p_value = std::min(whiteness_p_value(white.d, sampler.electrical()),
                                   whiteness_p_value(white.q, sampler.electrical()));
    e.rows = static_cast<std::size_t>(before.d.size());
    r.electrical = e;
    r.series_d = series(fitter, sampler.electrical(), before.d, after.d);
    r.series_q = series(fitter, sampler.electrical(), before.q, after.q);
  }
  if (before.torque.size()) {
    EquationError e{.unit = "Nm",
                    .before = rms_pair(before.torque, sampler.torque()),
                    .after = rms_pair(after.torque, sampler.torque())};
    e.no_change = no_change_torque(fitter);
    e.noise_floor = chain.noise().torque.rms();
    e.whiteness_p_value = whiteness_p_value(white.torque, sampler.torque());
    e.rows = static_cast<std::size_t>(before.torque.size());
    r.mechanical = e;
    r.series_torque = series(fitter, sampler.torque(), before.torque, after.torque);
  }
  const auto fall = [](const std::optional<EquationError>& e) {
    return e && e->after.train > 0 ? e->before.train / e->after.train : 0;
  };
  r.main_equation = fall(r.electrical) > fall(r.mechanical) ? "electrical" : "mechanical";
}

std::shared_ptr<const Effect> with_key(const char* kind, const char* key, double value) {
  const auto effect = make_effect(kind);
  set_key(*effect, key, value);
  return effect;
}

void from_samples(const DriveFacts& facts, const Health& health, TraceResult& r) {
  const auto add = [&](const char* kind, const char* key, double value) {
    if (!make_effect(kind)) return;
    TracedEffect e{.effect = with_key(kind, key, value), .equation = "sensing"};
    const auto [name, unit] = split(key);
    e.parameters = {{name, unit, value, {}, ""}};
    e.materiality = e.effect->materiality(facts);
    e.from_samples = true;
    r.effects.push_back(std::move(e));
  };
  if (health.coarse(facts.machine.i_rated)) add("adc_quantisation", "lsb_A", health.i_lsb);
  if (health.i_limit > 0) add("adc_clipping", "limit_A", health.i_limit);
  if (health.missing_share > 5e-4) add("missing_samples", "share", health.missing_share);
  if (health.stale_share > 5e-4) add("stale_samples", "share", health.stale_share);
}

// What one record can and cannot tell: the smallest effect worth reporting against its sigma.
void identifiability(const Fitter& fitter, const Dictionary& dictionary, const Fit& fit,
                     TraceResult& r) {
  std::map<std::string, double> best;  // by kind: sigma over smallest size
  const std::vector<Score> scores = score_all(fitter, fit, dictionary.whitened);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const std::string kind(dictionary.whitened[i].effect->kind());
    const double sigma =
        scores[i].effect && scores[i].sigma_in_sizes > 0 ? scores[i].sigma_in_sizes : 1e9;
    const auto [place, first] = best.emplace(kind, sigma);
    if (!first) place->second = std::min(place->second, sigma);
  }
  for (const auto& m : fit.members) best.erase(std::string(m->kind()));
  for (const auto& [kind, sigma] : best) {
    if (make_effect(kind)->regressor_count() == 0) continue;
    if (kBlind * sigma < 1) {
      r.identifiable.push_back(kind);
    } else {
      r.not_identifiable.emplace_back(
          kind,
          sigma > 1e8
              ? "this record does not excite it"
              : fmt::format("one sigma is {:.2g} of the smallest size worth reporting", sigma));
    }
  }
}

std::string sentence(const TraceResult& r) {
  std::vector<std::string> names;
  for (const TracedEffect& e : r.effects) {
    std::string name(e.effect->kind());
    if (!e.aliases.empty()) name += fmt::format(" (or {})", fmt::join(e.aliases, ", "));
    names.push_back(name);
  }
  const auto& main = r.main_equation == "electrical" ? r.electrical : r.mechanical;
  std::string fall;
  if (main && !names.empty())
    fall = fmt::format(
        "; with it the held-out {} error falls from {:.3g} to {:.3g} {} rms (noise {:.3g})",
        r.main_equation == "electrical" ? "voltage" : "torque", main->before.held_out,
        main->after.held_out, main->unit, main->noise_floor);
  std::string text = names.empty()
                         ? "Nothing of the catalogue is missing in the model"
                         : "The model lacks " + fmt::format("{}", fmt::join(names, ", ")) + fall;
  if (!r.unexplained.empty()) {
    std::vector<std::string> what;
    for (const Structure& s : r.unexplained) what.push_back(s.text);
    text += fmt::format("; outside the catalogue: {}", fmt::join(what, ", "));
  }
  return text + ".";
}

}  // namespace

TraceResult conclude(const Fitter& fitter, const Dictionary& dictionary, const Selection& selection,
                     const Health& health) {
  TraceResult r;
  const Fit& fit = selection.fit;
  const DriveFacts& facts = fitter.chain().equations().facts();
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    TracedEffect e = traced(fitter, fit, selection.members[m], m);
    if (fit.members[m]->kind() == "periodic_torque") {
      r.unexplained.push_back(line_structure(*fit.members[m], selection.members[m]));
      r.stop_gaps.push_back(std::move(e));
      continue;
    }
    for (const Alternative& a : selection.members[m].alternatives)
      r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain,
                            fmt::format("in place of {}: {}", e.effect->kind(), a.why)});
    if (!e.aliases.empty()) {
      Ambiguity a{.kinds = {std::string(e.effect->kind())}};
      a.kinds.insert(a.kinds.end(), e.aliases.begin(), e.aliases.end());
      a.why = "they explain this record equally well";
      a.would_separate = what_separates(a.kinds);
      r.ambiguous.push_back(std::move(a));
    }
    r.effects.push_back(std::move(e));
  }
  for (const Alternative& a : selection.refused)
    r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain, a.why});
  from_samples(facts, health, r);
  errors(fitter, fit, r);
  add_effect_views(fitter.chain(), fit, r);
  if (!health.coarse(facts.machine.i_rated))  // else what is left is the shape of the steps
    for (Structure& s : structure_of_rest(fitter, fit)) r.unexplained.push_back(std::move(s));
  r.structured = !r.unexplained.empty();
  r.corrections = corrections_of(r);
  identifiability(fitter, dictionary, fit, r);
  r.verdict = !r.effects.empty() ? (r.ambiguous.empty() ? "traced" : "ambiguous")
              : r.structured     ? "unexplained"
                                 : "nothing_missing";
  if (!r.effects.empty() && r.structured) r.verdict = "unexplained";
  r.sentence = sentence(r);
  const std::size_t told = r.identifiable.size(), all = told + r.not_identifiable.size();
  if (r.verdict == "nothing_missing" && 4 * told < all) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell: of {} kinds of effects this record could show {}; a longer record with "
        "several "
        "speeds in both directions, load and i_d is needed.",
        all, told == 0 ? "none" : fmt::format("only {}", fmt::join(r.identifiable, ", ")));
    std::vector<std::string> blind;
    for (const auto& [kind, why] : r.not_identifiable) blind.push_back(kind);
    r.ambiguous.push_back({blind, "this record does not excite them",
                           "a run that varies speed, load and i_d independently"});
  }
  return r;
}

}  // namespace twinrate

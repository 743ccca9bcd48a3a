#include "trace/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "model/effects/catalogue.hpp"
#include "trace/doubts.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

constexpr double kAliasGain = 15;  // score: two kinds closer than this explain the same
constexpr std::size_t kMostAliases = 5;
constexpr double kAliasShare = 0.02;  // or than this share of the gain; for a faint gain more,
constexpr double kAliasShareNoisy = 0.15,
                 kAliasGainNoisy = 300;  // because the residual is not all noise
constexpr double kMostOfIt = 0.5;        // of the gain of a step at an edge of the record
constexpr double kParameterPrice =
    60;  // score: below it, the price of a parameter or two decides nothing

std::string equation_of(const Effect& effect) {
  switch (effect.tracing().traits().equation) {
    case Traits::Equation::kElectrical:
      return "electrical";
    case Traits::Equation::kMechanical:
      return "mechanical";
    default:
      return "sensing";
  }
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

// Error of a parameter from sampling, however long the record is: means over an interval are exact
// to the third order. A moment lies anywhere between two rows. The impacts of a gap make the error
// rough as a function of its keys, and hardly depend on the damping, so the descent ends within
// some per cent of the best.
double accuracy(const Effect& effect, const NumericKey& key, double T_s) {
  constexpr double kSampled = 1e-4, kRough = 0.025, kRoughDamping = 0.1;
  if (key.key == "time_s") return T_s / std::sqrt(6.0);
  if (has_gap(effect))
    return (key.key.starts_with("damping") ? kRoughDamping : kRough) * std::abs(key.value);
  return kSampled * (key.key.ends_with("phase_rad") ? 1 : std::abs(key.value));
}

// Standard deviations of the keys of member m, from the covariance of the free parameters.
std::map<std::string, double> sigmas(const Fit& fit, const Eigen::MatrixXd& covariance,
                                     std::size_t m, double T_s) {
  std::vector<Eigen::Index> free;
  for (std::size_t p = 0; p < fit.free.size(); ++p)
    if (fit.free[p].member == m) free.push_back(static_cast<Eigen::Index>(p));
  std::map<std::string, double> out;
  const Effect& effect = *fit.members[m];
  const auto regressors = static_cast<std::size_t>(effect.tracing().regressor_count());
  std::vector<double> c(regressors);
  effect.tracing().coefficients(c);
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
      moved->tracing().set_coefficients(shifted);
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
    if (variance > 0) out[key.key] = std::hypot(std::sqrt(variance), accuracy(effect, key, T_s));
  }
  return out;
}

// The residual exceeds the sensors' noise: the model has unnamed errors, which can decide between
// two kinds that explain nearly the same energy.
constexpr double kFaulty = 1.5;        // energy; the drawn noise is known to about a third
constexpr double kFaultyShare = 0.01;  // of the energy that a kind explains

bool is_faulty(const Rows& rows, const Fit& fit, const std::string& equation) {
  const EquationEnergy left = rows.energy(fit.y, fit.y), noise = rows.noise(fit.y, fit.y);
  return (equation != "mechanical" && left.electrical > kFaulty * noise.electrical) ||
         (equation != "electrical" && left.torque > kFaulty * noise.torque);
}

// `unlike_noise`: factor of the margin for the errors of a coarse converter or of lost rows. The
// tolerance between two kinds grows by the same factor.
bool near(double a, double b, double unlike_noise) {
  return a > b - std::max({kAliasGain * unlike_noise, kAliasShare * b,
                           std::min(kAliasShareNoisy * b, kAliasGainNoisy * unlike_noise)});
}

// True for a step of the load that has hardly a record before it, or after it: what tells it from a
// load that is present all the time are a few rows, on which an angle may stay at one place in its
// count. By design: a tenth is two of the 24 blocks, and less than one that judges.
bool begins_at_an_edge(const Record& record, const Effect& effect) {
  constexpr double kEdge = 0.1;  // of the rows
  if (!is_placed(effect, Traits::Place::kMoment) || record.t.empty()) return false;
  const auto before =
      std::lower_bound(record.t.begin(), record.t.end(), get_key(effect, "time_s")) -
      record.t.begin();
  const double share = static_cast<double>(before) / static_cast<double>(record.t.size());
  return std::min(share, 1 - share) < kEdge;
}

// Share of the gain of a kind from which on another one may be it, where the data do not decide:
// where a lag may be present that is not traced (a filter of 55 us in the currents of a log of every
// 20th tick was an inductance, of which a lag explained 0.90), and where the rounding of the counts
// repeats (a lag of the angle at constant speed was a saturation, of which it explained 0.92).
constexpr double kMostly = 0.8;

bool may_be_open_lag(const Alternative& a, double gain) {
  const std::shared_ptr<Effect> other = make_effect(a.kind);
  return (is_of(*other, Traits::Family::kLag) || has_key(*other, "offset_rad")) &&
         a.score_gain > kMostly * gain;
}

}  // namespace

void take_parameters(const Fitter& fitter, const Fit& fit, std::size_t m, TracedEffect& e) {
  e.effect = fit.members[m];
  e.parameters = traced_parameters(
      *e.effect, sigmas(fit, covariance(fitter, fit), m, fitter.chain().equations().record().T_s));
  e.materiality = e.effect->tracing().materiality(fitter.chain().equations().facts());
}

TracedEffect traced_effect(const Fitter& fitter, const Fit& fit, const Selected& s, std::size_t m,
                           bool lag_is_open) {
  const Rows& rows = fitter.training();
  const double N = static_cast<double>(rows.count(fit.y));
  const Effect& effect = *fit.members[m];
  TracedEffect e{.effect = fit.members[m], .equation = equation_of(effect)};
  e.held_out_gain = s.held_out_gain;
  e.delta_bic = -s.score_gain;
  const double k = std::max(1, effect.tracing().regressor_count());
  const double ratio = s.without.rss / fit.rss;
  e.p_value = std::isnan(ratio) ? ratio : chi_square_tail(N * (ratio - 1), k);
  take_parameters(fitter, fit, m, e);
  const auto explains = [&](const Alternative& a) {
    if (s.score_gain > kParameterPrice) return a.score_gain;
    return a.score_gain + std::log(N) * (a.parameters - s.parameters);
  };
  const bool faulty = is_faulty(rows, fit, e.equation);
  const Equations& equations = fitter.chain().equations();
  const bool at_edge = begins_at_an_edge(equations.record(), effect);
  const bool repeats = equations.record().angle.lsb > 0 && at_constant_speed(equations);
  const auto as_much = [&](const Alternative& a) {
    return near(explains(a), s.score_gain, fitter.margin() / Fitter::kMargin) ||
           (at_edge && explains(a) > kMostOfIt * s.score_gain) ||
           (lag_is_open && may_be_open_lag(a, s.score_gain)) ||
           (repeats && explains(a) > kMostly * s.score_gain) ||
           (faulty && a.held_out_gain > (1 - kFaultyShare) * s.held_out_gain);
  };
  for (const Alternative& a : s.alternatives)
    if (a.why == kExplainsLess && e.aliases.size() < kMostAliases &&
        !std::count(e.aliases.begin(), e.aliases.end(), a.kind) && as_much(a))
      e.aliases.push_back(a.kind);
  return e;
}

}  // namespace twinrate

#include "trace/scores.hpp"

#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"

namespace twinrate {
namespace {

// The key with which the effect is in proportion; null if there is none.
const char* linear_key_of(const Effect& effect) {
  for (const TracedKey& key : effect.tracing().traced_keys())
    if (key.linear) return key.key;
  return nullptr;
}

// True for the same effect at the same place, or another form of an effect that can occur only
// once.
bool taken(const Fit& fit, const Effect& effect) {
  ShaftFacts shaft;
  if (effect.describe_shaft(shaft) && has_shaft(fit.members)) return true;
  for (const auto& m : fit.members) {
    if (m->kind() != effect.kind()) continue;
    const Traits::Repeats repeats = effect.tracing().traits().repeats;
    if (repeats.how == Traits::Repeats::kOnce || repeats_nearby(*m, effect)) return true;
    if (repeats.how == Traits::Repeats::kByKey &&
        get_key(*m, repeats.key) == get_key(effect, repeats.key))
      return true;
  }
  return false;
}

}  // namespace

bool repeats_nearby(const Effect& member, const Effect& newcomer) {
  const Traits::Repeats repeats = newcomer.tracing().traits().repeats;
  return member.kind() == newcomer.kind() && repeats.distance > 0 &&
         std::abs(get_key(member, repeats.key) - get_key(newcomer, repeats.key)) < repeats.distance;
}

std::size_t parameters_of(const Effect& effect) {
  auto count = static_cast<std::size_t>(effect.tracing().regressor_count());
  for (const TracedKey& key : effect.tracing().traced_keys())
    if (!key.linear || effect.tracing().regressor_count() == 0) ++count;
  return count;
}

double score_of(const Fitter& fitter, const Fit& fit) {
  if (!(fit.rss > 0)) return 1e300;  // the subtracted noise exceeds the residual
  const double N = static_cast<double>(fitter.training().count(fit.y));
  std::size_t k = 0;
  for (const auto& m : fit.members) k += parameters_of(*m);
  return N * std::log(fit.rss) + static_cast<double>(k) * std::log(N) +
         fitter.margin() * static_cast<double>(fit.members.size());
}

std::vector<Score> score_all(const Fitter& fitter, const Fit& fit,
                             const std::vector<Candidate>& candidates) {
  const Rows& rows = fitter.training();
  const DriveFacts& facts = fitter.chain().equations().facts();
  const auto P = static_cast<Eigen::Index>(fit.J.size());
  NormalEquations own{Eigen::MatrixXd(P, P), Eigen::VectorXd(P), Eigen::VectorXd(P)};
  for (Eigen::Index a = 0; a < P; ++a) {
    for (Eigen::Index c = 0; c <= a; ++c) own.A(a, c) = own.A(c, a) = rows.dot(fit.J[a], fit.J[c]);
    own.b[a] = rows.against(fit.J[a], fit.y);
    own.noise[a] = rows.noise(fit.J[a], fit.J[a]).sum();
  }
  const double N = static_cast<double>(rows.count(fit.y));
  std::vector<Score> scores(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& candidate = candidates[i];
    if (taken(fit, *candidate.effect) || fitter.leaves_out(*candidate.effect)) continue;
    const auto g = static_cast<Eigen::Index>(candidate.columns.size());
    NormalEquations normal{Eigen::MatrixXd(P + g, P + g), Eigen::VectorXd(P + g),
                           Eigen::VectorXd(P + g)};
    normal.A.topLeftCorner(P, P) = own.A;
    normal.b.head(P) = own.b;
    normal.noise.head(P) = own.noise;
    for (Eigen::Index c = 0; c < g; ++c) {
      const Sampled& x = candidate.columns[c];
      for (Eigen::Index a = 0; a < P; ++a)
        normal.A(a, P + c) = normal.A(P + c, a) = rows.dot(fit.J[a], x);
      for (Eigen::Index e = 0; e <= c; ++e)
        normal.A(P + e, P + c) = normal.A(P + c, P + e) = rows.dot(candidate.columns[e], x);
      normal.b[P + c] = rows.against(x, fit.y);
      normal.noise[P + c] = rows.noise(x, x).sum();
    }
    std::vector<char> use = normal.usable(N);
    for (Eigen::Index c = 0; c < g; ++c)
      if (!tells(*candidate.effect, static_cast<std::size_t>(c), normal.A(P + c, P + c), facts))
        use[static_cast<std::size_t>(P + c)] = 0;
    for (Eigen::Index c = normal.spurious(use); c >= 0; c = normal.spurious(use))
      use[static_cast<std::size_t>(c)] = 0;
    if (std::none_of(use.begin() + P, use.end(), [](char u) { return u != 0; })) continue;
    const Eigen::VectorXd x = normal.solve(use);
    EquationEnergy change;
    const auto brings = [&](double factor, const EquationEnergy& e) {
      change.electrical += factor * e.electrical;
      change.torque += factor * e.torque;
    };
    for (Eigen::Index c = 0; c < g; ++c) {
      const Sampled& column = candidate.columns[c];
      brings(-2 * x[P + c], rows.noise_against(column, fit.y));
      for (Eigen::Index e = 0; e < g; ++e)
        brings(x[P + c] * x[P + e], rows.noise(column, candidate.columns[e]));
    }
    const double explained = 2 * x.dot(normal.b) - x.dot(normal.A * x);
    const double rss = left_of(fit.rss - explained + noise_doubt(change), explained, N);
    if (!(rss > 0)) continue;
    Score& score = scores[i];
    score.effect = candidate.effect->clone();
    if (candidate.effect->tracing().regressor_count() > 0) {
      const Eigen::VectorXd sigma = normal.inverse(use).diagonal().tail(g).cwiseMax(0).cwiseSqrt();
      score.effect->tracing().set_coefficients(std::vector<double>(sigma.data(), sigma.data() + g));
      score.sigma_in_sizes = score.effect->tracing().materiality(facts);
      score.effect->tracing().set_coefficients(std::vector<double>(x.data() + P, x.data() + P + g));
    } else if (const char* key = linear_key_of(*score.effect)) {
      set_key(*score.effect, key, x[P] * get_key(*score.effect, key));
      if (x[P] <= 0) continue;
    } else if (x[P] < 0.1 || x[P] > 8) {
      continue;  // far from this point of the grid
    }
    score.valid = score.effect->tracing().materiality(facts) >= 0.5 &&
                  fitter.chain().equations().possible(*score.effect);
    const auto k = static_cast<double>(parameters_of(*candidate.effect));
    score.gain = N * std::log(fit.rss / rss) - k * std::log(N) - fitter.margin();
  }
  return scores;
}

}  // namespace twinrate

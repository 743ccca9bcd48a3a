#include "trace/plan.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/linear_algebra.hpp"

namespace twinrate {
namespace {

constexpr Eigen::Index kMostColumns = 8;  // of a group
constexpr double kRidge = 1e-8;           // as in NormalEquations
constexpr double kNothing = 1e-6;         // of the strongest combination of columns: no effect
constexpr double kSaturates = 5 * kEnoughSigmas;

using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostColumns, kMostColumns>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostColumns, 1>;

// Inverse norms of the columns; zero for a column without excitation or of noise alone (the rules
// of NormalEquations).
SmallVector scales(const Information& x, const PlanGroup& g) {
  SmallVector scale = SmallVector::Zero(g.count);
  for (Eigen::Index i = 0; i < g.count; ++i) {
    const double energy = x.M(g.first + i, g.first + i);
    if (energy > 1e-12 * x.rows && energy > x.noise[g.first + i]) scale[i] = 1 / std::sqrt(energy);
  }
  return scale;
}

// Products of the columns of two groups, scaled to unit norm.
Small correlation(const Information& x, const PlanGroup& a, const SmallVector& scale_a,
                  const PlanGroup& b, const SmallVector& scale_b) {
  return scale_a.asDiagonal() * x.M.block(a.first, b.first, a.count, b.count) *
         scale_b.asDiagonal();
}

// D(a), by the tracer's rule.
double sigmas_alone(const Information& x, const PlanGroup& a, const SmallVector& scale) {
  if ((scale.array() == 0).all()) return 0;
  const Eigen::MatrixXd own = correlation(x, a, scale, a, scale);
  const linear::SymmetricEigen eigen = linear::symmetric_eigen(own);
  const double most = eigen.values.maxCoeff();
  Eigen::VectorXd sigma = Eigen::VectorXd::Zero(a.count);
  for (Eigen::Index e = 0; e < a.count; ++e)
    if (eigen.values[e] > kNothing * most)
      sigma += (eigen.vectors.col(e).array().square() / eigen.values[e]).matrix();
  sigma = (sigma.array().sqrt() * scale.array()).matrix();
  const double size = a.size(sigma);
  return size > 0 && std::isfinite(size) ? 1 / size : 0;
}

// The smallest effect of a group, column by column, in standard deviations; their squares add.
SmallVector strengths(const PlanGroup& a, const SmallVector& scale) {
  const double share = 1 / std::sqrt(static_cast<double>(a.count));
  SmallVector s = SmallVector::Zero(a.count);
  for (Eigen::Index i = 0; i < a.count; ++i)
    if (scale[i] > 0) s[i] = share * a.smallest[i] / scale[i];
  return s;
}

// D(a|b)
double sigmas_beside(const Information& x, const PlanGroup& a, const SmallVector& scale_a,
                     const PlanGroup& b, const SmallVector& scale_b) {
  const SmallVector strength = strengths(a, scale_a);
  const Small C = correlation(x, a, scale_a, b, scale_b);
  Small B = correlation(x, b, scale_b, b, scale_b);
  for (Eigen::Index i = 0; i < b.count; ++i) B(i, i) = 1 + kRidge;
  const Small taken = C * B.ldlt().solve(Small(C.transpose()));
  double sum = 0;
  for (Eigen::Index i = 0; i < a.count; ++i)
    sum += strength[i] * strength[i] * std::max(0.0, 1 - taken(i, i));
  return std::sqrt(sum);
}

double clearness(double strength, double beside, double N) {
  const auto gain = [&](double sigmas) { return N * std::log1p(sigmas * sigmas / N); };
  const double enough = std::max(kEnoughSigmas * kEnoughSigmas, kEnoughShare * gain(strength));
  return kEnoughSigmas * std::sqrt(gain(beside) / enough);
}

// D(a|all) of each kind, represented by its group `best`.
void beside_all(const Information& x, const std::vector<const PlanGroup*>& best,
                std::vector<KindOutlook>& all) {
  constexpr double kRidgeOfAll = 1e-6;
  std::vector<Eigen::Index> of;
  std::vector<double> scale;
  for (const PlanGroup* g : best)
    for (Eigen::Index i = 0; g && i < g->count; ++i) {
      of.push_back(g->first + i);
      scale.push_back(scales(x, *g)[i]);
    }
  const auto n = static_cast<Eigen::Index>(of.size());
  Eigen::MatrixXd C(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      C(i, j) = i == j ? 1 + kRidgeOfAll : scale[i] * x.M(of[i], of[j]) * scale[j];
  const Eigen::VectorXd variance =
      linear::solve_symmetric(C, Eigen::MatrixXd::Identity(n, n)).diagonal().cwiseMax(1);
  Eigen::Index at = 0;
  for (const PlanGroup* g : best) {
    if (!g) continue;
    const SmallVector strength = strengths(*g, scales(x, *g));
    double sum = 0;
    for (Eigen::Index i = 0; i < g->count; ++i, ++at)
      sum += strength[i] * strength[i] * (1 / variance[at]);
    all[g->kind].beside_all = std::sqrt(sum);
  }
}

double use(double sigmas) {
  return std::log1p(std::pow(std::min(sigmas, kSaturates), 2));
}

}  // namespace

Eigen::VectorXd smallest_of(const std::function<double(const Eigen::VectorXd&)>& size,
                            Eigen::Index count) {
  Eigen::VectorXd smallest = Eigen::VectorXd::Zero(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    double c = 1;
    for (int j = 0; j < 60; ++j) {  // a size may grow with a power of the coefficient
      const double now = size(c * Eigen::VectorXd::Unit(count, i));
      if (!(now > 0) || !std::isfinite(now)) {
        c = 0;
        break;
      }
      c /= now;
      if (std::abs(now - 1) < 1e-9) break;
    }
    smallest[i] = c;
  }
  return smallest;
}

Information Information::none(Eigen::Index P) {
  return {Eigen::MatrixXd::Zero(P, P), Eigen::VectorXd::Zero(P), 0};
}

Information& Information::operator+=(const Information& other) {
  M += other.M;
  noise += other.noise;
  rows += other.rows;
  return *this;
}

Information operator*(double factor, Information information) {
  information.M *= factor;
  information.noise *= factor;
  information.rows *= factor;
  return information;
}

std::vector<KindOutlook> outlook(const Information& information, const PlanCandidates& candidates) {
  const std::size_t K = candidates.kinds.size();
  std::vector<KindOutlook> all(K);
  for (std::size_t k = 0; k < K; ++k) {
    all[k].beside.assign(K, 0);
    all[k].sine.assign(K, 0);
    all[k].clear.assign(K, 0);
    all[k].nearest = k;
  }
  std::vector<SmallVector> scale;
  for (const PlanGroup& g : candidates.groups) scale.push_back(scales(information, g));
  std::vector<const PlanGroup*> best(K, nullptr);
  std::vector<double> beside(K);
  for (std::size_t i = 0; i < candidates.groups.size(); ++i) {
    const PlanGroup& a = candidates.groups[i];
    KindOutlook& kind = all[a.kind];
    const double alone = sigmas_alone(information, a, scale[i]);
    if (alone > kind.alone) {
      kind.alone = alone;
      best[a.kind] = &a;
    }
    const double strength = strengths(a, scale[i]).norm();
    if (strength == 0) continue;
    beside.assign(K, strength);
    for (std::size_t j = 0; j < candidates.groups.size(); ++j) {
      const PlanGroup& b = candidates.groups[j];
      if (b.kind != a.kind)
        beside[b.kind] =
            std::min(beside[b.kind], sigmas_beside(information, a, scale[i], b, scale[j]));
    }
    for (std::size_t b = 0; b < K; ++b) {
      const double c = clearness(strength, beside[b], information.rows);
      if (c <= kind.clear[b]) continue;
      kind.clear[b] = c;
      kind.beside[b] = beside[b];
      kind.sine[b] = beside[b] / strength;
    }
  }
  beside_all(information, best, all);
  for (std::size_t k = 0; k < K; ++k)
    for (std::size_t b = 0; b < K; ++b)
      if (b != k && (all[k].nearest == k || all[k].clear[b] < all[k].clear[all[k].nearest]))
        all[k].nearest = b;
  return all;
}

double worth(const std::vector<KindOutlook>& outlook) {
  double sum = 0;
  const auto others = static_cast<double>(std::max<std::size_t>(2, outlook.size()) - 1);
  for (std::size_t a = 0; a < outlook.size(); ++a) {
    sum += use(outlook[a].alone) + use(outlook[a].beside_all);
    for (std::size_t b = 0; b < outlook.size(); ++b)
      if (b != a) sum += use(outlook[a].clear[b]) / others;
  }
  return sum;
}

std::vector<std::size_t> choose(const std::vector<PlanPiece>& pieces, const Information& start,
                                const PlanCandidates& candidates, const PlanSettings& settings) {
  std::vector<std::size_t> chosen;
  Information now = start;
  double left_s = settings.longest_s, worth_now = worth(outlook(now, candidates));
  while (!(settings.stop && settings.stop())) {
    std::size_t best = pieces.size();
    double best_rate = 0, best_worth = worth_now;
    for (std::size_t p = 0; p < pieces.size(); ++p) {
      if (pieces[p].duration_s > left_s) continue;
      Information with = now;
      const double next = worth(outlook(with += pieces[p].information, candidates));
      const auto again = std::count(chosen.begin(), chosen.end(), p);
      const double rate =
          (next - worth_now) / pieces[p].duration_s / static_cast<double>(1 + again);
      if (rate > best_rate) best = p, best_rate = rate, best_worth = next;
    }
    if (best == pieces.size() || best_rate < settings.enough * worth_now) break;
    now += pieces[best].information;
    left_s -= pieces[best].duration_s;
    worth_now = best_worth;
    chosen.push_back(best);
    if (settings.say) settings.say(best, worth_now);
  }
  return chosen;
}

}  // namespace twinrate

#include "trace/static_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/load_part.hpp"
#include "model/linear_algebra.hpp"
#include "trace/bounded_fit.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<StaticTerm> copies(const std::vector<StaticTerm>& terms) {
  std::vector<StaticTerm> all = terms;
  for (StaticTerm& term : all) term.effect = term.effect->clone();
  return all;
}

// Weighted contribution of one effect at every point, with the channels stacked.
VectorXd explained(const StaticProblem& p, Effect& effect) {
  effect.prepare(p.facts);
  const Index n = p.y.rows(), m = p.y.cols();
  VectorXd column(n * m);
  for (Index k = 0; k < n; ++k) {
    const OperatingPoint& point = p.points[static_cast<std::size_t>(k)];
    const Eigen::RowVectorXd row = p.observe(effect.at(point), point).cwiseQuotient(p.scale);
    for (Index c = 0; c < m; ++c) column[c * n + k] = row[c];
  }
  return column;
}

double small_step(const Effect& effect, const std::string& key) {
  for (const NumericKey& k : numeric_keys(effect))
    if (k.key == key) return std::min(1.0, 1e-3 * k.hi);
  return 1;
}

}  // namespace

MatrixXd columns_of(const StaticProblem& p, const std::vector<StaticTerm>& terms) {
  std::vector<VectorXd> columns;
  for (const StaticTerm& term : terms) {
    const auto effect = term.effect->clone();
    for (const auto& key : term.linear) set_key(*effect, key, 0);
    const VectorXd none = explained(p, *effect);
    for (const auto& key : term.linear) {
      const double step = small_step(*effect, key);
      set_key(*effect, key, step);
      columns.push_back((explained(p, *effect) - none) / step);
      set_key(*effect, key, 0);
    }
  }
  MatrixXd A(p.y.size(), static_cast<Index>(columns.size()));
  for (std::size_t j = 0; j < columns.size(); ++j) A.col(static_cast<Index>(j)) = columns[j];
  return A;
}

VectorXd weighed_residual(const StaticProblem& p) {
  const MatrixXd scaled = p.y.array().rowwise() / p.scale.array();
  return Eigen::Map<const VectorXd>(scaled.data(), scaled.size());
}

namespace {

struct RowsOfRoles {
  VectorXd y;
  std::vector<Index> training, held_out;
  RowsOfRoles(const StaticProblem& p, PointRole last) : y(weighed_residual(p)) {
    const Index n = p.y.rows();
    for (Index k = 0; k < y.size(); ++k) {
      const PointRole role = p.role[static_cast<std::size_t>(k % n)];
      if (role <= last)
        training.push_back(k);
      else if (role == next(last))
        held_out.push_back(k);
    }
  }
  static PointRole next(PointRole role) {
    return role == PointRole::kFits ? PointRole::kChooses : PointRole::kJudges;
  }
};

double mean_square(const VectorXd& rest, const std::vector<Index>& rows) {
  return rows.empty() ? 0 : VectorXd(rest(rows)).squaredNorm() / static_cast<double>(rows.size());
}

// The linear keys by least squares, and the residual of the training rows.
struct Solved {
  VectorXd x;
  double cost = 0;
};

Solved solve(const RowsOfRoles& rows, const MatrixXd& A) {
  const VectorXd y = rows.y(rows.training);
  if (A.cols() == 0) return {VectorXd(), y.squaredNorm()};
  const MatrixXd A_train = A(rows.training, Eigen::all);
  Solved s{linear::least_squares(A_train, y), 0};
  s.cost = (y - A_train * s.x).squaredNorm();
  return s;
}

// Cost with one searched key at `value`.
double cost_at(const StaticProblem& p, const RowsOfRoles& rows, std::vector<StaticTerm>& terms,
               StaticTerm& term, const std::string& key, double value) {
  p.hooks.checkpoint();
  set_key(*term.effect, key, value);
  return solve(rows, columns_of(p, terms)).cost;
}

void search(const StaticProblem& p, const RowsOfRoles& rows, std::vector<StaticTerm>& terms) {
  constexpr int kGrid = 12;
  for (StaticTerm& term : terms)
    for (const SearchedKey& s : term.searched) {
      double best = s.lo, best_cost = -1;
      for (int i = 0; i <= kGrid; ++i) {
        const double value = s.lo * std::pow(s.hi / s.lo, i / static_cast<double>(kGrid));
        const double cost = cost_at(p, rows, terms, term, s.key, value);
        if (best_cost < 0 || cost < best_cost) best = value, best_cost = cost;
      }
      set_key(*term.effect, s.key, best);
    }
}

// A key in the solver: in its own unit, or a searched key by its logarithm.
struct FreeKey {
  std::size_t term;
  std::string key;
  bool searched;
  double unit;

  double value(double x) const { return searched ? std::exp(x) : unit * x; }
  double deviation(double x, double sigma) const { return sigma * (searched ? value(x) : unit); }
};

struct Misfit {
  const StaticProblem* p;
  const RowsOfRoles* rows;
  const std::vector<FreeKey>* keys;
  mutable std::vector<StaticTerm> terms;

  void operator()(const double* x, double* residual) const {
    for (std::size_t j = 0; j < keys->size(); ++j)
      set_key(*terms[(*keys)[j].term].effect, (*keys)[j].key, (*keys)[j].value(x[j]));
    VectorXd rest = rows->y;
    for (const StaticTerm& term : terms) rest -= explained(*p, *term.effect);
    Eigen::Map<VectorXd>(residual, static_cast<Index>(rows->training.size())) =
        rest(rows->training);
  }
};

// Refines all keys at once from the result of the search, with their standard deviations.
// fit.in_range: false if a key would have to leave its range.
void refine(const StaticProblem& p, const RowsOfRoles& rows, StaticFit& fit) {
  constexpr int kMostIterations = 60;
  std::vector<FreeKey> keys;
  std::vector<double> x;
  BoundedProblem bounded;
  for (std::size_t t = 0; t < fit.terms.size(); ++t) {
    const StaticTerm& term = fit.terms[t];
    for (const auto& key : term.linear) {
      const double at = get_key(*term.effect, key);
      keys.push_back({t, key, false, std::max(std::abs(at), small_step(*term.effect, key))});
      x.push_back(at / keys.back().unit);
      bounded.lo.push_back(-std::numeric_limits<double>::max());
      bounded.hi.push_back(-bounded.lo.back());
    }
    for (const SearchedKey& s : term.searched) {
      keys.push_back({t, s.key, true, 1});
      x.push_back(std::log(get_key(*term.effect, s.key)));
      bounded.lo.push_back(std::log(s.lo));
      bounded.hi.push_back(std::log(s.hi));
    }
  }
  fit.sigma.assign(fit.terms.size(), {});
  if (keys.empty()) return;
  bounded.residual = Misfit{&p, &rows, &keys, copies(fit.terms)};
  bounded.residuals = static_cast<int>(rows.training.size());
  bounded.max_iterations = kMostIterations;
  bounded.function_tolerance = 1e-12;
  static auto* const fit_within_bounds = reinterpret_cast<FitWithinBounds*>(load_part("ceres"));
  BoundedFit found;
  fit_within_bounds(bounded, x, found);
  for (std::size_t j = 0; j < keys.size(); ++j)
    fit.in_range =
        set_key(*fit.terms[keys[j].term].effect, keys[j].key, keys[j].value(x[j])) && fit.in_range;

  if (found.covariance.empty()) return;
  const std::size_t P = keys.size();
  const double freedom =
      std::max<double>(1, static_cast<double>(rows.training.size()) - static_cast<double>(P));
  const double variance = 2 * found.cost / freedom;
  for (std::size_t j = 0; j < P; ++j)
    fit.sigma[keys[j].term][keys[j].key] =
        keys[j].deviation(x[j], std::sqrt(std::max(0.0, variance * found.covariance[j * P + j])));
}

// Rms by channel over `rows`, which are indices into the stacked channels.
Eigen::RowVectorXd channel_rms(const MatrixXd& rest, const std::vector<Index>& rows) {
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(rest.cols());
  const Index n = rest.rows();
  for (const Index row : rows) sum[row / n] += std::pow(rest(row % n, row / n), 2);
  const double count = static_cast<double>(rows.size()) / static_cast<double>(rest.cols());
  return (sum / std::max(count, 1.0)).cwiseSqrt();
}

// The residual of the terms, and its errors.
void compare(const StaticProblem& p, const RowsOfRoles& rows, StaticFit& fit) {
  VectorXd rest = rows.y;
  Effects effects;
  for (const StaticTerm& term : fit.terms) {
    fit.in_range = term.effect->prepare(p.facts).empty() && fit.in_range;
    rest -= explained(p, *term.effect);
    effects.push_back(term.effect);
  }
  if (p.possible) fit.in_range = fit.in_range && p.possible(effects);
  fit.cost = mean_square(rest, rows.training);
  fit.held_out_cost = mean_square(rest, rows.held_out);
  fit.rest = Eigen::Map<const MatrixXd>(rest.data(), p.y.rows(), p.y.cols());
  fit.rest = (fit.rest.array().rowwise() * p.scale.array()).matrix();
  fit.train = channel_rms(fit.rest, rows.training);
  fit.held_out = channel_rms(fit.rest, rows.held_out);
}

}  // namespace

const StaticTerm* StaticFit::find(std::string_view kind) const {
  for (const StaticTerm& term : terms)
    if (term.effect->kind() == kind) return &term;
  return nullptr;
}

StaticFit fit_static(const StaticProblem& p, const std::vector<StaticTerm>& terms, PointRole last) {
  p.hooks.checkpoint();
  const RowsOfRoles rows(p, last);
  StaticFit fit;
  fit.terms = copies(terms);
  search(p, rows, fit.terms);
  const VectorXd start = solve(rows, columns_of(p, fit.terms)).x;
  Index j = 0;
  for (StaticTerm& term : fit.terms) {
    for (const auto& key : term.linear) set_key(*term.effect, key, start[j++]);
    fit.parameters += static_cast<int>(term.linear.size() + term.searched.size());
  }
  refine(p, rows, fit);
  compare(p, rows, fit);
  return fit;
}

StaticFit first_terms(const StaticProblem& p, StaticFit fit, std::size_t count, PointRole last) {
  fit.terms.resize(count);
  fit.sigma.resize(count);
  compare(p, RowsOfRoles(p, last), fit);
  return fit;
}

}  // namespace twinrate

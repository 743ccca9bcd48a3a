#include "trace/static_fit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/linear_algebra.hpp"
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

// Weighed values of one effect at every point, channels below one another.
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

// One column for each linear key of each term, at the searched keys as they stand.
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

struct Rows {
  VectorXd y;
  std::vector<Index> training, held_out;
  explicit Rows(const StaticProblem& p) : y(weighed_residual(p)) {
    const Index n = p.y.rows();
    for (Index k = 0; k < y.size(); ++k)
      (p.held_out[static_cast<std::size_t>(k % n)] ? held_out : training).push_back(k);
  }
};

struct Solved {
  VectorXd x, rest;
  double cost = 0, held_out_cost = 0;
};

double mean_square(const VectorXd& rest, const std::vector<Index>& rows) {
  return rows.empty() ? 0 : VectorXd(rest(rows)).squaredNorm() / static_cast<double>(rows.size());
}

Solved solve(const Rows& rows, const MatrixXd& A) {
  Solved s;
  const MatrixXd A_train = A(rows.training, Eigen::all);
  const VectorXd y_train = rows.y(rows.training);
  s.x = A.cols() == 0 ? VectorXd() : linear::least_squares(A_train, y_train);
  s.rest = A.cols() == 0 ? rows.y : VectorXd(rows.y - A * s.x);
  s.cost = mean_square(s.rest, rows.training);
  s.held_out_cost = mean_square(s.rest, rows.held_out);
  return s;
}

// Cost with one searched key at `value`.
double cost_at(const StaticProblem& p, const Rows& rows, std::vector<StaticTerm>& terms,
               StaticTerm& term, const std::string& key, double value) {
  p.hooks.checkpoint();
  set_key(*term.effect, key, value);
  return solve(rows, columns_of(p, terms)).cost;
}

// Golden section on the logarithm of the key.
void refine(const StaticProblem& p, const Rows& rows, std::vector<StaticTerm>& terms,
            StaticTerm& term, const std::string& key, double lo, double hi) {
  constexpr double kGolden = 0.618033988749895;
  double a = std::log(lo), b = std::log(hi);
  double x1 = b - kGolden * (b - a), x2 = a + kGolden * (b - a);
  const auto cost = [&](double x) { return cost_at(p, rows, terms, term, key, std::exp(x)); };
  double f1 = cost(x1), f2 = cost(x2);
  for (int i = 0; i < 22; ++i) {
    if (f1 < f2) {
      b = x2, x2 = x1, f2 = f1;
      f1 = cost(x1 = b - kGolden * (b - a));
    } else {
      a = x1, x1 = x2, f1 = f2;
      f2 = cost(x2 = a + kGolden * (b - a));
    }
  }
  set_key(*term.effect, key, std::exp((a + b) / 2));
}

void search(const StaticProblem& p, const Rows& rows, std::vector<StaticTerm>& terms) {
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
  for (const double width : {2.0, 1.6, 1.3, 1.15, 1.08})
    for (StaticTerm& term : terms)
      for (const SearchedKey& s : term.searched) {
        const double now = get_key(*term.effect, s.key);
        refine(p, rows, terms, term, s.key, std::max(s.lo, now / width),
               std::min(s.hi, now * width));
      }
}

// Standard deviations from the Jacobian at the solution, every key free.
void add_sigma(const StaticProblem& p, const Rows& rows, StaticFit& fit) {
  struct Slot {
    std::size_t term;
    std::string key;
    double step;
  };
  std::vector<Slot> slots;
  for (std::size_t i = 0; i < fit.terms.size(); ++i) {
    const StaticTerm& term = fit.terms[i];
    for (const auto& key : term.linear)
      slots.push_back({i, key, 1e-3 * std::abs(get_key(*term.effect, key))});
    for (const auto& s : term.searched)
      slots.push_back({i, s.key, 1e-4 * get_key(*term.effect, s.key)});
  }
  fit.sigma.assign(fit.terms.size(), {});
  if (slots.empty()) return;
  MatrixXd J(static_cast<Index>(rows.training.size()), static_cast<Index>(slots.size()));
  for (std::size_t j = 0; j < slots.size(); ++j) {
    const auto effect = fit.terms[slots[j].term].effect->clone();
    const double step = std::max(slots[j].step, 1e-12), at = get_key(*effect, slots[j].key);
    const VectorXd here = explained(p, *effect);
    set_key(*effect, slots[j].key, at + step);
    J.col(static_cast<Index>(j)) = VectorXd((explained(p, *effect) - here) / step)(rows.training);
  }
  const double freedom =
      std::max<double>(1, static_cast<double>(rows.training.size() - slots.size()));
  const double variance = fit.cost * static_cast<double>(rows.training.size()) / freedom;
  const VectorXd norm = J.colwise().norm().cwiseMax(1e-300);
  const MatrixXd scaled = J * norm.cwiseInverse().asDiagonal();
  const MatrixXd covariance = linear::pseudo_inverse(scaled.transpose() * scaled);
  for (std::size_t j = 0; j < slots.size(); ++j) {
    const Index k = static_cast<Index>(j);
    fit.sigma[slots[j].term][slots[j].key] =
        std::sqrt(std::max(0.0, variance * covariance(k, k))) / norm[k];
  }
}

Eigen::RowVectorXd channel_rms(const StaticProblem& p, const MatrixXd& rest, bool held_out) {
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(rest.cols());
  int count = 0;
  for (Index k = 0; k < rest.rows(); ++k)
    if (static_cast<bool>(p.held_out[static_cast<std::size_t>(k)]) == held_out) {
      sum += rest.row(k).cwiseAbs2();
      ++count;
    }
  return (sum / std::max(count, 1)).cwiseSqrt();
}

double criterion(const StaticFit& fit, double N) {
  return N * std::log(std::max(fit.cost, 1e-300)) + fit.parameters * std::log(N);
}

// One step of the selection; false: none is worth it.
bool add_best(const StaticProblem& p, const std::vector<StaticTerm>& candidates, double least_gain,
              double N, StaticSelection& selection) {
  StaticFit best;
  std::string kind;
  double best_criterion = criterion(selection.after, N);
  const double before = best_criterion;
  for (const StaticTerm& candidate : candidates) {
    std::vector<StaticTerm> terms = selection.after.terms;
    std::erase_if(
        terms, [&](const StaticTerm& t) { return t.effect->kind() == candidate.effect->kind(); });
    terms.push_back(candidate);
    StaticFit fit = fit_static(p, terms);
    const double gain = 1 - fit.held_out_cost / std::max(selection.after.held_out_cost, 1e-300);
    if (!fit.in_range || gain < least_gain || criterion(fit, N) > best_criterion - 10) continue;
    best_criterion = criterion(fit, N);
    kind = candidate.effect->kind();
    best = std::move(fit);
  }
  if (kind.empty()) return false;
  selection.steps.push_back(
      {kind, best_criterion - before, 1 - best.held_out_cost / selection.after.held_out_cost});
  selection.after = std::move(best);
  p.hooks.tell(
      fmt::format("{}: held-out error -{:.1f} %", kind, 100 * selection.steps.back().holdout_gain));
  return true;
}

}  // namespace

const StaticTerm* StaticFit::find(std::string_view kind) const {
  for (const StaticTerm& term : terms)
    if (term.effect->kind() == kind) return &term;
  return nullptr;
}

StaticFit fit_static(const StaticProblem& p, const std::vector<StaticTerm>& terms) {
  p.hooks.checkpoint();
  const Rows rows(p);
  StaticFit fit;
  fit.terms = copies(terms);
  search(p, rows, fit.terms);
  const Solved s = solve(rows, columns_of(p, fit.terms));
  Index j = 0;
  for (StaticTerm& term : fit.terms) {
    for (const auto& key : term.linear)
      fit.in_range = set_key(*term.effect, key, s.x[j++]) && fit.in_range;
    fit.in_range = term.effect->prepare(p.facts).empty() && fit.in_range;
    fit.parameters += static_cast<int>(term.linear.size() + term.searched.size());
  }
  if (p.possible) {
    Effects effects;
    for (const StaticTerm& term : fit.terms) effects.push_back(term.effect);
    fit.in_range = fit.in_range && p.possible(effects);
  }
  fit.cost = s.cost;
  fit.held_out_cost = s.held_out_cost;
  fit.rest = Eigen::Map<const MatrixXd>(s.rest.data(), p.y.rows(), p.y.cols());
  fit.rest = (fit.rest.array().rowwise() * p.scale.array()).matrix();
  fit.train = channel_rms(p, fit.rest, false);
  fit.held_out = channel_rms(p, fit.rest, true);
  add_sigma(p, rows, fit);
  return fit;
}

StaticSelection select_static(const StaticProblem& p, const std::vector<StaticTerm>& always,
                              const std::vector<StaticTerm>& candidates, double least_gain) {
  StaticSelection selection;
  selection.before = fit_static(p, always);
  selection.after = selection.before;
  const double N = static_cast<double>(p.y.cols()) *
                   static_cast<double>(std::count(p.held_out.begin(), p.held_out.end(), 0));
  try {
    for (std::size_t round = 0; round < 2 * candidates.size(); ++round)
      if (!add_best(p, candidates, least_gain, N, selection)) break;
  } catch (const TraceStopped&) {
    if (selection.steps.empty()) throw;
    selection.interrupted = true;
  }
  return selection;
}

std::vector<char> chess_board(const std::vector<double>& x, const std::vector<double>& y) {
  const auto ranks = [](const std::vector<double>& values) {
    std::vector<double> levels(values);
    std::sort(levels.begin(), levels.end());
    levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
    std::vector<std::size_t> rank(values.size());
    for (std::size_t k = 0; k < values.size(); ++k)
      rank[k] = static_cast<std::size_t>(std::lower_bound(levels.begin(), levels.end(), values[k]) -
                                         levels.begin());
    return std::pair(rank, levels.size());
  };
  const auto [row, rows] = ranks(x);
  const auto [column, columns] = ranks(y);
  if (rows * columns > 2 * x.size()) return every_other(x);  // scattered points
  std::vector<char> held_out(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) held_out[k] = (row[k] + column[k]) % 2 == 1;
  return held_out;
}

std::vector<char> every_other(const std::vector<double>& x) {
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return x[a] < x[b]; });
  std::vector<char> held_out(x.size());
  for (std::size_t k = 0; k < order.size(); ++k) held_out[order[k]] = k % 2 == 1;
  return held_out;
}

}  // namespace twinrate

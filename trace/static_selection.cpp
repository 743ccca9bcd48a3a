#include "trace/static_selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace twinrate {
namespace {

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
  p.hooks.tell(fmt::format("{}: held-out error {:+.1f} %", kind,
                           -100 * selection.steps.back().holdout_gain));
  return true;
}

}  // namespace

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

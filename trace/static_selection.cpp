#include "trace/static_selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trace/static_gate.hpp"

namespace twinrate {
namespace {

double criterion(const StaticFit& fit, double N) {
  return N * std::log(std::max(fit.cost, 1e-300)) + fit.parameters * std::log(N);
}

// One step of the selection; false: no candidate is good enough.
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

std::vector<StaticTerm> considered_terms(const Considered& considered,
                                         std::vector<StaticTerm> terms) {
  std::erase_if(terms, [&](const StaticTerm& term) { return !considered(term.effect->kind()); });
  return terms;
}

StaticSelection select_static(const StaticProblem& p, const std::vector<StaticTerm>& always,
                              const std::vector<StaticTerm>& candidates, double least_gain) {
  StaticSelection selection;
  selection.before = fit_static(p, always);
  selection.after = selection.before;
  const double N = static_cast<double>(p.y.cols()) *
                   static_cast<double>(std::count(p.role.begin(), p.role.end(), PointRole::kFits));
  try {
    for (std::size_t round = 0; round < 2 * candidates.size(); ++round)
      if (!add_best(p, candidates, least_gain, N, selection)) break;
  } catch (const TraceStopped&) {
    if (selection.steps.empty()) throw;
    selection.interrupted = true;
  }
  StaticProblem unstopped = p;  // the gate is short, and only passed terms are reported
  unstopped.hooks.stop = {};
  pass_gate(unstopped, selection);
  return selection;
}

}  // namespace twinrate

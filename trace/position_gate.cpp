#include "trace/position_gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trace/gate.hpp"
#include "trace/position_effects.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

// Of the squared error of "nothing changes", for noise that both have; by design, not measured.
constexpr double kOverNothing = 1.05;

struct Weakest {
  const PositionClaim* claim = nullptr;
  double p = 0;
  int votes = 0;
};

}  // namespace

void refuse_claims(Found& found, const Judge& judge, TraceResult& r) {
  const Criterion criterion;
  const std::vector<PositionClaim>& all = position_claims();
  while (true) {
    Weakest weakest;
    for (const PositionClaim& claim : all) {
      if (!claim.found(found)) continue;
      Found less = found;
      claim.drop(less);
      const std::vector<double> votes =
          judge.votes(found, found.model(), less.model(), criterion.silent);
      const double p = signed_rank_tail(votes);
      if (p > criterion.chance / static_cast<double>(all.size()) && p > weakest.p)
        weakest = {&claim, p, static_cast<int>(votes.size())};
    }
    if (!weakest.claim) return;
    const bool told = weakest.claim->told(found);
    weakest.claim->drop(found);
    if (!told) continue;
    r.refused.push_back({.kind = weakest.claim->kind,
                         .rule = "transfer",
                         .number = weakest.p,
                         .text = fmt::format("chance lowers the error of the held-out rows ({} "
                                             "pieces) as far in a share of {:.2g} of logs",
                                             weakest.votes, weakest.p)});
  }
}

void refuse_whole(Found& found, const Judge& judge, TraceResult& r) {
  const bool unseen = judge.unseen();
  for (const PositionLog* log : judge.logs()) {
    if (log->judges.empty() && log->held_out != unseen) continue;
    Errors e;
    judge.add(*log, unseen, found, found.model(), e);
    const bool rises = e.after > e.before,
               worse = judge.by_speed() && e.after > e.no_change * kOverNothing;
    if (!rises && !worse) continue;
    const double against = rises ? e.before : e.no_change;
    for (const PositionClaim& claim : position_claims()) {
      if (!claim.found(found)) continue;
      const bool told = claim.told(found);
      claim.drop(found);
      if (!told) continue;
      r.refused.push_back({.kind = claim.kind,
                           .rule = "whole",
                           .file = log->path,
                           .number = std::sqrt(e.after / against),
                           .text = rises ? "all effects together raise the error"
                                         : "all effects together predict worse than no change"});
    }
    return;
  }
}

}  // namespace twinrate

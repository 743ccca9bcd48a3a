#include "trace/position_gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "model/effects/catalogue.hpp"
#include "trace/gate.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

// A sort of claim: whether it is there, and how it is taken away.
struct Sort {
  std::string kind;
  std::function<bool(const Found&)> there;
  std::function<void(Found&)> drop;
};

std::vector<Sort> sorts() {
  const std::string lag(make_of(Traits::Family::kLag)->kind());
  return {
      {"cogging", [](const Found& f) { return !f.holding.cogging.empty(); },
       [](Found& f) { f.holding.cogging.clear(); }},
      {"friction_ripple", [](const Found& f) { return !f.holding.friction_ripple.empty(); },
       [](Found& f) { f.holding.friction_ripple.clear(); }},
      {"coulomb_friction", [](const Found& f) { return f.T_C() != 0; },
       [](Found& f) { f.holding.T_C = f.spin.T_C = 0; }},
      {"inertia", [](const Found& f) { return f.spin.gain > 0; },
       [](Found& f) { f.spin.gain = 0; }},
      {lag, [](const Found& f) { return f.speed_lag.lag() > 0; },
       [](Found& f) { f.speed_lag = {}; }},
  };
}

struct Weakest {
  const Sort* sort = nullptr;
  double p = 0;
  int votes = 0;
};

}  // namespace

void refuse_claims(Found& found, const Judge& judge, TraceResult& r) {
  const Criterion criterion;
  const std::vector<Sort> all = sorts();
  while (true) {
    Weakest weakest;
    for (const Sort& sort : all) {
      if (!sort.there(found)) continue;
      Found less = found;
      sort.drop(less);
      const std::vector<double> votes =
          judge.votes(found, found.model(), less.model(), criterion.silent);
      const double p = signed_rank_tail(votes);
      if (p > criterion.chance / static_cast<double>(all.size()) && p > weakest.p)
        weakest = {&sort, p, static_cast<int>(votes.size())};
    }
    if (!weakest.sort) return;
    weakest.sort->drop(found);
    r.refused.push_back(
        {.kind = weakest.sort->kind,
         .rule = "transfer",
         .number = weakest.p,
         .text = fmt::format("rows that judge ({} pieces) fall with it by chance in {:.2g} of logs",
                             weakest.votes, weakest.p)});
  }
}

void refuse_whole(Found& found, const Judge& judge, TraceResult& r) {
  const Criterion criterion;
  const bool unseen =
      std::any_of(judge.logs().begin(), judge.logs().end(), [](auto* l) { return l->held_out; });
  for (const PositionLog* log : judge.logs()) {
    if (log->held_out != unseen) continue;
    Errors e;
    judge.add(*log, found, found.model(), e);
    const bool rises = e.after > e.before,
               worse = judge.by_speed() && e.after > e.no_change * criterion.over_nothing;
    if (!rises && !worse) continue;
    const double against = rises ? e.before : e.no_change;
    for (const Sort& sort : sorts()) {
      if (!sort.there(found)) continue;
      sort.drop(found);
      r.refused.push_back({.kind = sort.kind,
                           .rule = "whole",
                           .file = log->path,
                           .number = std::sqrt(e.after / against),
                           .text = rises ? "all together raise the error"
                                         : "all together predict worse than no change"});
    }
    return;
  }
}

}  // namespace twinrate

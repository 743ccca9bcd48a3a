// Effects that a static set lacks: forward selection by the best candidate that also lowers the
// error on the points that choose.
#pragma once
#include "trace/considered.hpp"
#include "trace/point_gate.hpp"
#include "trace/static_fit.hpp"

namespace twinrate {

struct StaticStep {
  std::string kind;
  double delta_bic = 0, holdout_gain = 0;  // of the error before this step
};

// Of one channel: the part of the residual that neighbouring points share.
struct StaticRest {
  std::string channel;
  double share = 0, size = 0;  // of the power of the residual; rms in the channel's unit
};

struct StaticSelection {
  StaticFit before;     // the declared model
  StaticFit constants;  // with the constants alone
  StaticFit after;      // with the effects that passed the gate
  std::vector<StaticStep> steps;
  std::vector<Judgement> judgements;  // of after.terms
  std::vector<Refused> refused;
  std::vector<StaticRest> left;
  bool interrupted = false;  // after the last step: more effects may be missing
};

// The terms of considered kinds.
std::vector<StaticTerm> considered_terms(const Considered& considered,
                                         std::vector<StaticTerm> terms);

// Forward selection: of all candidates the one with the best criterion N log(cost) + k log(N), as
// long as it removes `least_gain` of the residual mean square on the points that choose. A
// candidate of a kind that is already present replaces it. Then the gate. If stopped before the
// first step, throws TraceStopped.
StaticSelection select_static(const StaticProblem& problem, const std::vector<StaticTerm>& always,
                              const std::vector<StaticTerm>& candidates, double least_gain = 0.1);

}  // namespace twinrate

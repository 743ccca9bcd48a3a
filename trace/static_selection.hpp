// Which effects a static set lacks: forward by the best candidate that also helps the points kept
// back, and which points those are.
#pragma once
#include "trace/static_fit.hpp"

namespace twinrate {

struct StaticStep {
  std::string kind;
  double delta_bic = 0, holdout_gain = 0;  // of the error that was left before this one
};

struct StaticSelection {
  StaticFit before;  // with `always` alone: constants are free on both sides
  StaticFit after;
  std::vector<StaticStep> steps;
  bool interrupted = false;  // after the last step: more may be missing
};

// Forward: of all candidates the one with the best criterion N log(cost) + k log(N), as long as it
// takes `least_gain` of the mean square of the held-out rest with it. A candidate of a kind that is
// already there replaces it. Stopped before the first step: throws TraceStopped.
StaticSelection select_static(const StaticProblem& problem, const std::vector<StaticTerm>& always,
                              const std::vector<StaticTerm>& candidates, double least_gain = 0.1);

// Every other point of a grid, like the fields of one colour of a chess board; of points that form
// no grid every other one in the order of the first coordinate.
std::vector<char> chess_board(const std::vector<double>& x, const std::vector<double>& y);
std::vector<char> every_other(const std::vector<double>& x);

}  // namespace twinrate

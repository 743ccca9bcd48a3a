// Selects the missing effects. Forward selection adds the best candidate, or two if each alone is
// refused. Members that are no longer needed are dropped, and members are swapped for better ones.
// Every accepted set is refined before the next candidates are scored (trace/scores.hpp).
//
// A candidate must lower the score on the training blocks, lower the error on the held-out blocks,
// and reach the smallest size worth reporting (Effect::materiality). Spectral lines without a cause
// in the catalogue (trace/lines.hpp) compete with the effects, so that no effect is selected
// because it reduces such a line.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

// Ratio of held-out errors above which a set is worse than another one that explains nearly the
// same on the training blocks.
inline constexpr double kWorseRatio = 1.2;
inline constexpr double kTwoMissing = 20;  // margins that each of two must gain to be added at once
inline constexpr const char* kExplainsLess = "explains less";  // or the same

struct Alternative {
  std::string kind;
  // Of the refined set, against the set without it. If it is not refined, the gain of the score is
  // an estimate and the held-out gain is NaN.
  double score_gain = 0, held_out_gain = 0;
  std::string why;        // reason why it was not selected
  double parameters = 0;  // number of its parameters
};

struct Selected {
  Fit without;            // the other members alone, refined
  double score_gain = 0;  // of the member
  double held_out_gain = 0;
  double parameters = 0;
  std::vector<Alternative> alternatives;  // best first
};

struct Selection {
  Fit fit;
  std::vector<Selected> members;     // of the fit
  std::vector<Alternative> refused;  // scored and not needed
  int stopped_after = 0;             // number of rounds; 0: not stopped
};

// State that one round hands to the next.
struct RoundState {
  bool added = true;   // the last round added an effect
  int gaps_left = 2;   // remaining searches for a gap, each of which is long
  int lines_left = 2;  // remaining searches for a torsion in the sensors' noise
  // With candidates that were refused: the one of the largest gain, and the inertia or shaft that
  // removes most of the torque error in the sensors' noise. Their gains are kTwoMissing margins, and
  // larger than that of the added effect.
  std::vector<Fit> refused = {};
};
// Drops the members that are not needed and adds the best candidate if it is acceptable.
Fit select_one(const Fitter& fitter, const std::vector<Candidate>& candidates,
               const Members& members, const Say& say, RoundState& state);
// Swaps members for better ones, drops those that raise the held-out error, and gives the gain and
// the alternatives of each.
Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const Members& members, const Say& say);
// The gain and the alternatives of each member; swaps and drops none.
Selection compare_alternatives(const Fitter& fitter, const std::vector<Candidate>& candidates,
                               const Members& members);
// The fit of a trace that was stopped; the gains of its members are NaN.
Selection not_judged(Fit fit, int rounds);

}  // namespace twinrate

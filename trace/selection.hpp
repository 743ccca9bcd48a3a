// Which effects are missing: forward by the best candidate (by two where each alone is refused),
// backward by what is no longer needed, swaps; every accepted set is refined before the next look
// (trace/scores.hpp).
//
// A candidate must lower the score on the training blocks, lower the error on the held-out blocks,
// and be large enough to matter (Effect::materiality). Lines that no cause of the catalogue makes
// (trace/lines.hpp) compete with the causes, so that none of them is taken to mend a line.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

// Times the held-out error of two sets that explain nearly the same where they were fitted.
inline constexpr double kWorseRatio = 1.2;
inline constexpr const char* kExplainsLess = "explains less";  // or no more

struct Alternative {
  std::string kind;
  // Of the refined set, against the set without; not refined: an estimate, and NaN.
  double score_gain = 0, held_out_gain = 0;
  std::string why;        // why it was not taken
  double parameters = 0;  // how many it has
};

struct Selected {
  Fit without;            // the others alone, refined
  double score_gain = 0;  // of having it
  double held_out_gain = 0;
  double parameters = 0;
  std::vector<Alternative> alternatives;  // best first
};

struct Selection {
  Fit fit;
  std::vector<Selected> members;     // of the fit
  std::vector<Alternative> refused;  // looked at and not needed
  int stopped_after = 0;             // rounds; 0: not stopped
};

// From one round to the next.
struct RoundState {
  bool added = true;   // the last round added an effect
  int gaps_left = 2;   // searches for a gap, which are long, before shafts are taken as they are
  int lines_left = 2;  // and for a shaft beside a line
};
// Drops from `members` what is not needed and adds the best candidate, if one is good enough.
Fit select_one(const Fitter& fitter, const std::vector<Candidate>& candidates,
               const Members& members, const Say& say, RoundState& state);
// Swaps members for better ones, and says of each what speaks for it.
Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const Members& members, const Say& say);
// The members as they are, with what could stand in the place of each.
Selection compare_alternatives(const Fitter& fitter, const std::vector<Candidate>& candidates,
                               const Members& members);
// The fit as it stands, of a trace that was stopped: nothing speaks for its members (not a number).
Selection not_judged(Fit fit, int rounds);

}  // namespace twinrate

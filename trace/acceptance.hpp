// What the selection and the judge share: the order in which candidates are looked at, and what a
// newcomer must bring.
#pragma once
#include <functional>

#include "trace/scores.hpp"

namespace twinrate {

using Say = std::function<void(const std::string&)>;

// Candidates of one sort differ in a place on a grid only.
std::string sort_of(const Effect& effect);

// Best of each sort beside the fit, best sort first; lines (trace/lines.hpp) among them.
std::vector<Score> ranked(const Fitter& fitter, const std::vector<Candidate>& candidates,
                          const Fit& fit);

// Whether the last member of `next`, which `now` does not have, may be taken: it lowers the error
// on held-out blocks, is large enough to matter, not absurdly large, and is there in all of the
// record.
bool acceptable(const Fitter& fitter, const Fit& next, const Fit& now);

// False where it is larger than what a running drive lacks: something else, told in its words.
bool plausible(const Effect& effect, const DriveFacts& facts);

// Whether a shaft that was refused takes so much of the held-out error that it stands for a gap
// whose impacts cannot be followed: an overdamped shaft does, and nothing else.
bool like_a_gap(const Fitter& fitter, const Fit& next, const Fit& now);

// Of the plain error: a gap that leaves less is one.
inline constexpr double kGapErrorRatio = 0.75;

// What a shaft leaves of the torque before whitening, as a square and as a sum over pieces, and of the held-out
// blocks, whitened.
struct LeftByShaft {
  double plain = 0, pieces = 0, held_out = 0;
};
// Whether a gap takes the place of a shaft without one. `gain`: by how much the shaft lowers the score; `more`: the
// gap besides.
bool is_gap(const LeftByShaft& gap, const LeftByShaft& shaft, double gain, double more,
            double margin);

// By how much the gain of one effect may fall short of another's in its place: a dead time is not
// told as an inverter's drop whose slope explains, or mends, next to nothing.
double credit(const Effect& effect, const Effect& other, double gain);

// The fit without the members that do not pay for their parameters.
Fit without_superfluous(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate

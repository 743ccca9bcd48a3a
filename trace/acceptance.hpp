// Common parts of the selection and the judge: the ranking of the candidates, and the conditions
// that a newcomer must meet.
#pragma once
#include <functional>

#include "trace/scores.hpp"

namespace twinrate {

using Say = std::function<void(const std::string&)>;

// Kind of an effect, with its choices if it has no regressors. Candidates of one sort differ only
// in their grid point.
std::string sort_of(const Effect& effect);

// The best candidate of each sort beside the fit, the best first, including lines
// (trace/lines.hpp).
std::vector<Score> ranked(const Fitter& fitter, const std::vector<Candidate>& candidates,
                          const Fit& fit);

// True if the last member of `next`, which `now` does not have, is acceptable: it lowers the
// held-out error, reaches the smallest size worth reporting, is plausible, and is present in all of
// the record.
bool acceptable(const Fitter& fitter, const Fit& next, const Fit& now);

// False if the effect is larger than any that a running drive can have: it has another cause.
bool plausible(const Effect& effect, const DriveFacts& facts);

// True if a refused shaft removes so much of the held-out error that it represents a gap whose
// impacts cannot be simulated. Only an overdamped shaft does.
bool like_a_gap(const Fitter& fitter, const Fit& next, const Fit& now);

// Share of the energy of the residual torque: a gap that leaves less is accepted.
inline constexpr double kGapErrorRatio = 0.75;

// Residuals with a shaft: of the torque in the noise of the sensors (placing.hpp), as an energy and
// as a sum of the norms of pieces, and of the held-out blocks, whitened.
struct LeftByShaft {
  double energy = 0, pieces = 0, held_out = 0;
};
// True if a shaft with a gap replaces one without. `gain`: fall of the score by the shaft without a
// gap; `more`: further fall by the gap.
bool is_gap(const LeftByShaft& gap, const LeftByShaft& shaft, double gain, double more,
            double margin);

// Amount by which the gain of `effect` may be smaller than that of `other` in its place. It is
// positive for a dead time against an inverter's drop, so that a drop whose slope explains almost
// nothing is not reported.
double credit(const Effect& effect, const Effect& other, double gain);

// The fit without the members that do not justify their parameters.
Fit without_superfluous(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate

// Effects whose place on their grid has to be searched before Gauss-Newton can refine it, because
// the error is flat or rough around it.
#pragma once
#include <optional>

#include "trace/scores.hpp"

namespace twinrate {

// A moment (load_step) searched more and more finely, a torsion by simplex, the zone of what turns
// at a current's zero by its grid; any other effect as it is.
std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect);

// The torsion that leaves least, by simplex from the best of the candidates: where it rings at all
// times, the noise is part resonance, and whitened by that no torsion scores.
std::shared_ptr<Effect> search_torsion(const Fitter& fitter, const Fit& now,
                                       const std::vector<Candidate>& candidates);

// A gap looks like a soft shaft until the load mass is followed through it, and its impacts make
// the error rough in the parameters: backlash in the place of `shaft`, searched on
// grids around it and away from it, then by simplex. Nothing where none comes near.
std::optional<Fit> search_backlash(const Fitter& fitter, const Fit& now, const Effect& shaft);
// The same near a gap that is about right.
Fit search_closer(const Fitter& fitter, const Fit& now, const Effect& shaft);

// False for a shaft whose resonance is beyond the tracer's band, or damped too much to be one.
bool rings(const Effect& effect);
// Of the torque equation with the fit's members, before whitening: its square, and whether that is
// so far above what noise makes that a gap is worth looking for.
double plain_torque(const Fitter& fitter, const Fit& fit);
// The same as a sum over pieces of their norms: an impact that was not met spoils one of them.
double plain_pieces(const Fitter& fitter, const Fit& fit);
bool leaves_more_than_noise(const Fitter& fitter, const Fit& fit);

}  // namespace twinrate

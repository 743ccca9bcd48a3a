// Effects whose place on their grid has to be searched before Gauss-Newton can refine it, because
// the error is flat or rough around it.
#pragma once
#include <optional>

#include "trace/scores.hpp"

namespace twinrate {

// Searches the moment of a load step in ever finer steps, the keys of a torsion by simplex, and the
// zone of an effect that depends on a current's zero from its grid. Returns any other effect
// unchanged.
std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect);

// The torsion with the smallest residual torque, by simplex from the best candidates. If the shaft
// rings all the time, the noise model contains its resonance, and after whitening by that model no
// torsion has a good score. Null if there is no candidate.
std::shared_ptr<Effect> search_torsion(const Fitter& fitter, const Fit& now,
                                       const std::vector<Candidate>& candidates);

// Searches a backlash that replaces `shaft`: on grids around it and away from it, then by simplex.
// A gap looks like a soft shaft until the load mass is simulated through it. Its impacts make the
// error a rough function of the parameters, because each changes the later ones. So the load is tied
// to the measured torque first, and then ever looser. None if no gap fits nearly as well as the
// shaft.
std::optional<Fit> search_backlash(const Fitter& fitter, const Fit& now, const Effect& shaft);
// The same from a start near the solution.
Fit search_closer(const Fitter& fitter, const Fit& now, const Effect& shaft);

// False for a shaft whose resonance is above the tracer's band, or damped too much to be one.
bool rings(const Effect& effect);
// Squared norm of the residual torque with the fit's members, after the filter that whitens the
// noise of the sensors. (The noise of an angle makes a torque that grows with the square of the
// frequency, and hides a resonance; whitening by the residual would hide it, too.)
double torque_energy(const Fitter& fitter, const Fit& fit);
// Fall of the log likelihood by `next` in that noise, times two, less the fall that a lighter motor
// makes in the noise itself. The noise model of a search contains a resonance that is missing in
// `now`, and whitens it away.
double fall_in_sensors(const Fitter& fitter, const Fit& now, const Fit& next);
// The same residual as a sum of the norms of pieces: a missed impact spoils only one of them.
double torque_by_pieces(const Fitter& fitter, const Fit& fit);
// True if that energy is more than twice that of its noise.
bool leaves_more_than_noise(const Fitter& fitter, const Fit& fit);

}  // namespace twinrate

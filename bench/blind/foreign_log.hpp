// Drawn logs with other physics, control and motions than those of draw_case and make_log: a test of
// the tracer that does not share the errors of the project's plant.
//
//   rich, stairs   speeds of both signs, or of one; known loads, i_d (rich)
//   sines, chirp   speeds that change all the time
//   p2p, jog       moves with rests
//   prbs           two speeds in random order
//   torque         i_q of both signs, turned around at a speed
//   one_start, steady, slow
//
// A third of the logs begin in motion. Some loops have no decoupling, and some a dither. The
// readings are floors of the angle (or an angle with noise), rounded currents with noise, and the
// bus voltage.
#pragma once
#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

// The header of the case (machine, profile, mode, true kinds) and its log. Half of the seeds have
// no effect, the others one to three.
std::pair<DrawnCase, DrawnLog> draw_foreign(std::uint64_t seed);

}  // namespace twinrate::blind

// dc_bus_ripple, read off the logged bus voltage.
//
//   v_dc(t_k) = slow part + sum_n A_n sin(2 pi f_n t_k + phase_n) + noise
//
// The slow part (load, drift, steps) is a moving average over 0.1 s, taken off v_dc and off the
// sines alike. A line is a peak of the averaged spectrum of the training rows that stands out of
// the bins on both sides of it; frequency, amplitude and phase are refined by least squares over
// all of them at once. It is an effect where
//   - its amplitude is worth reporting (3e-3 of the bus voltage) and eight sigmas or more,
//   - it goes on: one frequency and phase fit the whole record (files have clocks of their own, and
//     a phase each), and the held-out rows carry the same amplitude,
//   - it passes the gate's rule of transfer (trace/transfer.hpp) on the held-out rows, in four pieces
//     a stretch of them: a ripple that comes and goes does not,
//   - it is not the drive's own: where the power 3/2 u'i has a line there, too, no bus would sag by
//     so much under it.
// Sigmas come from the noise beside the line, no less than 1e-6 of the bus voltage.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "trace/considered.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct BusRipple {
  std::vector<TracedEffect> effects;   // in the order in which they were found
  std::optional<EquationError> error;  // of v_dc less its slow part, V; where there are effects
  std::vector<TracePicture> pictures;
  bool own_clocks = false;         // files have a phase each: the effects' is that of the longest
  std::string blind;               // why the smallest could not be seen; empty: it could
  std::vector<std::string> notes;  // lines that are not an effect, and why
  std::vector<Refused> refused;    // those that the gate's rule of transfer refused
};

// `held_out`: of each row. `known`: effects of the declared model; what they do to the bus is taken
// off first. Excluded, a ripple is a note.
BusRipple find_bus_ripple(const Record& record, const std::vector<char>& held_out,
                          const DriveFacts& facts, const Effects& known,
                          const Considered& considered = {});

}  // namespace twinrate

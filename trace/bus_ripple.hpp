// Traces dc_bus_ripple from the logged bus voltage.
//
//   v_dc(t_k) = slow part + sum_n A_n sin(2 pi f_n t_k + phase_n) + noise
//
// The slow part (load, drift, steps) is a moving average over 0.1 s. It is subtracted from v_dc and
// from the sines alike. A line is a peak of the averaged spectrum of the training rows that exceeds
// the bins on both sides. Least squares over all lines at once refines frequency, amplitude and
// phase. A line is an effect if
//   - its amplitude is worth reporting (3e-3 of the bus voltage) and at least eight sigmas,
//   - one frequency and one phase fit the whole record (each file has its own clock, and so its own
//     phase), and the held-out rows have the same amplitude,
//   - it passes the gate's rule of transfer (trace/transfer.hpp) on the held-out rows, with four
//     pieces in each of their stretches: an intermittent ripple fails,
//   - the drive itself does not cause it: the power 3/2 u'i has no line at this frequency, or one
//     too weak to make any bus sag that much.
// Sigmas come from the noise beside the line, and are at least 1e-6 of the bus voltage.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "trace/considered.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct BusRipple {
  std::vector<TracedEffect> effects;   // in the order in which they were found
  std::optional<EquationError> error;  // of v_dc less its slow part, V; set if there are effects
  std::vector<TracePicture> pictures;
  bool own_clocks = false;         // files have a phase each; the effects have that of the longest
  std::string blind;               // why the smallest ripple is invisible; empty: it is visible
  std::vector<std::string> notes;  // lines that are not an effect, and why
  std::vector<Refused> refused;    // lines that the gate's rule of transfer refused
};

// `held_out`: of each row. `known`: effects of the declared model; their bus ripple is subtracted
// first. If the kind is excluded, a ripple becomes a note.
BusRipple find_bus_ripple(const Record& record, const std::vector<char>& held_out,
                          const DriveFacts& facts, const Effects& known,
                          const Considered& considered = {});

}  // namespace twinrate

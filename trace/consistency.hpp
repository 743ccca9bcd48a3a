// Do the log and the drive file belong together? Asked of the raw signals, before any effect.
//
// The raw equations give the scale of each quantity against the drive file (trace/scale_factors.hpp).
// A scale far beyond any effect of a working drive is a unit (milliamperes, degrees, milliseconds), a
// convention (line-to-line, rms) or another machine. Of the conventions, the one is named whose
// factor fits all scales that the log shows. A log whose rotor frame does not fit is read with
// other angles and other orders of the phases; if one of them fits, it is named.
#pragma once
#include <string>
#include <vector>

#include "model/drive_facts.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Beyond these a scale is no effect of a working drive: magnets lose a fifth when hot, copper gains
// two thirds from cold to hot, iron saturates to a half, a load adds to the inertia. What a voltage
// bends with a small current passes for several times a small R_s. As factors, or their inverses.
struct ScaleBounds {
  double psi_f = 1.33, R_s = 30, L = 3;
  double lightest = 3, heaviest = 30;  // of K_t/J: times as much, or as little
};
inline constexpr ScaleBounds kThisMachine;

// `encoder_counts`: of the drive file; 0: not known. Empty: nothing speaks against the log.
std::vector<Inconsistency> inconsistencies(const Record& record, const Health& health,
                                           const DriveFacts& facts, int encoder_counts = 0);
// Why the sign of the motor's torque is open; empty: it is not. Currents of the other sign, phases in
// another order and an angle turned by half make a motor seem to brake. Where its speed is held and
// the currents are too small to show in the voltage, nothing tells that from a load that drives it.
std::string sign_in_doubt(const Record& record, const DriveFacts& facts);
// What the voltage of a row is, in a log that has not every tick of the controller. Taken for the mean
// from row to row, which the voltage equation needs, a tick's voltage has the frame of half an
// interval later: an angle with another zero, or a voltage that acts late.
struct VoltageMeaning {
  std::string doubt;     // why it is not that mean; empty: it is, or it hardly matters
  double open_e = 0;     // rad, electrical: turn of an interval too short to tell the two apart
  bool of_tick = false;  // where that is open: a tick's fits better
};
VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts);
// The record with each tick's voltage turned to the middle of its interval: a slow rotor's mean.
Record with_mean_of_ticks(const Record& record, const DriveFacts& facts);
// The result of a trace that ends there: verdict and sentence, no effect.
TraceResult inconsistent_result(std::vector<Inconsistency> found, const Health& health);

}  // namespace twinrate

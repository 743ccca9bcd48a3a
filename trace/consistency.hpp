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

// `encoder_counts`: of the drive file; 0: not known. Empty: nothing speaks against the log.
std::vector<Inconsistency> inconsistencies(const Record& record, const Health& health,
                                           const DriveFacts& facts, int encoder_counts = 0);
// Why the sign of the motor's torque is open; empty: it is not. Currents of the other sign, phases in
// another order and an angle turned by half make a motor seem to brake. Where its speed is held and
// the currents are too small to show in the voltage, nothing tells that from a load that drives it.
std::string sign_in_doubt(const Record& record, const DriveFacts& facts);
// The result of a trace that ends there: verdict and sentence, no effect.
TraceResult inconsistent_result(std::vector<Inconsistency> found, const Health& health);

}  // namespace twinrate

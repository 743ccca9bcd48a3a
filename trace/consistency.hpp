// Checks from the raw signals, before any effect, that the log and the drive file belong together.
//
// The raw equations give the scale of each quantity against the drive file
// (trace/scale_factors.hpp). A scale far beyond any effect of a working drive means a wrong unit
// (milliamperes, degrees, milliseconds), another convention (line-to-line, rms) or another machine.
// The convention that is named is the one whose factor fits all scales that the log shows. A log
// whose rotor frame does not fit is read with other angles and other orders of the phases. If one
// of these readings fits, it is named.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "model/drive_facts.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"

namespace twinrate {

// `encoder_counts`: of the drive file; 0: unknown. Empty: the log and the drive file agree.
std::vector<Inconsistency> inconsistencies(const Record& record, const Health& health,
                                           const DriveFacts& facts, int encoder_counts = 0);
// The reason why theta_m may not show the speed: from row to row the rotor may turn by more than half a
// turn, of which an angle within one turn shows the remainder. Empty: it shows the speed. `found`:
// the inconsistencies. A unit or another reading explains the log; another machine may be such a
// speed.
std::string hidden_turns(const Record& record, const Health& health, const DriveFacts& facts,
                         const std::vector<Inconsistency>& found);
// Of currents that are far above the rated one; `sizes`: of each row, A.
std::optional<Inconsistency> far_current(std::vector<double> sizes, const DriveFacts& facts);
// The reason why the sign of the motor's torque is open; empty: it is known. Currents of the other
// sign, another order of the phases and an angle turned by half a turn make a motor seem to brake.
// If the speed is held and the currents are too small to show in the voltage, the log does not
// distinguish such an error from a load that drives the motor.
std::string sign_in_doubt(const Record& record, const DriveFacts& facts);
// One of them as a message: quantity, expected, found, hint.
std::string inconsistency_in_words(const Inconsistency& inconsistency);
// Those of one of several logs, with its name; none where hidden turns may be their reason.
std::vector<Inconsistency> inconsistencies_of_file(const Record& record, const Health& health,
                                                   const DriveFacts& facts, int encoder_counts);
// The result of a trace that ends at this check: verdict and sentence, no effect.
TraceResult inconsistent_result(std::vector<Inconsistency> found, const Health& health);

}  // namespace twinrate

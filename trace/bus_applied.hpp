// What a ripple of the bus leaves of the voltage that the drive asked for. The duties were made for
// the bus voltage at the start of the interval; what acts is its change since then.
#pragma once
#include "model/effects/effect.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct MachineParameters;

// The record with the voltage that ripples of `effects` (those on the bus) leave of what the drive
// asked for, u mean(v_dc over the interval)/v_dc(t_k), and with v_dc as other effects take it:
// without the ripple.
Record as_applied(Record record, const Effects& effects);
// Whether the machine felt that voltage rather than the one in the log, which may have been
// measured: what the plain voltage equation leaves of the log, over the difference of the two, is
// -1 where it did and 0 where not. Without currents or a difference: true, the log has what the
// drive asked for.
bool acted(const Record& record, const Record& applied, const MachineParameters& machine);

}  // namespace twinrate

// The voltage that acts on the machine under a ripple of the bus. The duties are computed for the
// bus voltage at the start of the interval, so only the change since then acts.
#pragma once
#include "model/effects/effect.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct MachineParameters;

// The record with the acting voltage u mean(v_dc over the interval)/v_dc(t_k) under the ripples of
// `effects`, and with v_dc less these ripples, as the other effects use it.
Record as_applied(Record record, const Effects& effects);
// True if the machine received the voltage of `applied` rather than the one in the log. The
// residual of the plain voltage equation with the logged voltage, projected on the difference of
// the two voltages, is -1 if so and 0 if the log holds a measured voltage. True as well without
// currents or without a difference.
bool acted(const Record& record, const Record& applied, const MachineParameters& machine);

}  // namespace twinrate

// The settings of the fixed-point filter for a drive file: constants, start, policy, n and the table
// of policy `scheduled` (the rotor gains of estimator/gain_schedule.hpp).
#pragma once
#include "core/config.hpp"
#include "firmware/cortex_m3/constants.hpp"
#include "firmware/cortex_m3/reading.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Throws BadInput if the drive file asks for a filter, prediction or policy that the firmware does
// not have, or if a quantity of the 32-bit variant does not fit its format.
m3::Settings fixed_settings(Config& config);

// The machine in the form that the firmware's constants need.
m3::Machine fixed_machine(Config& config);

// MEASUREMENT as a SAMPLE of the link.
twp_sample sample_of(const Measurement& m);

}  // namespace twinrate

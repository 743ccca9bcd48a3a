// The settings of the fixed-point filter for a drive file: constants, start, policy, n and the table
// of policy `scheduled` (the rotor gains of estimator/gain_schedule.hpp).
#pragma once
#include "core/config.hpp"
#include "firmware/cortex_m3/constants.hpp"
#include "firmware/cortex_m3/reading.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Throws BadInput where the drive file asks for what the firmware does not have (another filter,
// prediction or policy), or where a quantity of the 32-bit variant would not fit its format.
m3::Settings fixed_settings(Config& config);

// The machine as the firmware's constants take it.
m3::Machine fixed_machine(Config& config);

// MEASUREMENT as the link carries it.
twp_sample sample_of(const Measurement& m);

}  // namespace twinrate

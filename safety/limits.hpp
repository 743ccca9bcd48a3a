// Faults against which a drive protects itself, and the meaning of "off" for each fault.
//
// This folder has no I/O, no clock, no heap and no exceptions: time is counted in ticks, so the
// same code runs in the simulated plant and in a drive's firmware.
#pragma once
#include <array>
#include <cstddef>

#include "core/reason.hpp"

namespace twinrate {

// short: the zero voltage vector; the motor brakes on its own resistance and cannot raise the bus.
// open: all switches off; the diodes carry the current until it is zero, and rectify if the EMF
// between two phases is above the bus voltage.
enum class Off : int { kShort = 0, kOpen = 1 };
inline constexpr const char* kOffNames[] = {"short", "open"};

// Faults that lead to SAFE. The order is their priority if several occur at one tick.
enum class Fault : int {
  kEmergencyStop,
  kOverCurrent,
  kOverVoltage,
  kUnderVoltage,
  kOverSpeed,
  kOverTemperature,
  kSensorLost,
  kCommandNotFinite,
  kCommandLost,
  kSupervisorLost,
  kSafeRequested,
};
inline constexpr std::size_t kFaultCount = 11;

// The key of each fault in [safety.off_at], and its reason code.
struct FaultRow {
  Fault fault;
  const char* key;
  Reason reason;
};
inline constexpr std::array<FaultRow, kFaultCount> kFaults = {{
    {Fault::kEmergencyStop, "emergency_stop", Reason::kEmergencyStop},
    {Fault::kOverCurrent, "over_current", Reason::kOverCurrent},
    {Fault::kOverVoltage, "over_voltage", Reason::kOverVoltage},
    {Fault::kUnderVoltage, "under_voltage", Reason::kUnderVoltage},
    {Fault::kOverSpeed, "over_speed", Reason::kOverSpeed},
    {Fault::kOverTemperature, "over_temperature", Reason::kOverTemperature},
    {Fault::kSensorLost, "sensor_lost", Reason::kSensorLost},
    {Fault::kCommandNotFinite, "command_not_finite", Reason::kCommandNotFinite},
    {Fault::kCommandLost, "command_lost", Reason::kCommandLost},
    {Fault::kSupervisorLost, "supervisor_lost", Reason::kSupervisorLost},
    {Fault::kSafeRequested, "safe_requested", Reason::kSafeRequested},
}};

struct SafetyLimits {
  double T_s = 0;                      // control period, s
  double i_trip = 0;                   // amplitude of the current vector, A
  double v_dc_max = 0;                 // V
  double v_dc_min = 0;                 // V
  double omega_m_max = 0;              // rad/s
  double temperature_derate = 0;       // degC; a drive without such a signal gives none
  double temperature_max = 0;          // degC
  double i_derate = 0;                 // A: DERATE leaves its share of this one
  int hold_ticks = 20;                 // ticks without a command for which the last voltage is held
  int sensor_ticks = 50;               // ticks for which readings are predicted
  std::array<Off, kFaultCount> off{};  // by Fault
};

}  // namespace twinrate

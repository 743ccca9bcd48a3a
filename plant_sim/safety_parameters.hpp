// [safety] of a drive file: the limits beyond which the drive switches off, and how.
//
// A limit of 0 is the default of the machine:
//
//   machine.i_trip_A     max(4 i_rated, 2 i_max_A of the controller)
//   v_dc_max_V           1.3 v_dc
//   v_dc_min_V           0.5 v_dc
//   omega_m_max_rad_s    the larger one of 2 max(rated speed, references) and the speed whose EMF
//                        is 1.2 times the voltage limit
//
//   temperature_derate_degC  20 K below temperature_max_degC
//
// Rated current: model/per_unit.hpp. Without temperature_max_degC the temperature is not watched.
// DERATE leaves a share of i_max_A of the controller, or of half of the trip current if it has none.
#pragma once
#include "core/config.hpp"
#include "safety/current_limit.hpp"
#include "safety/sensor_watch.hpp"
#include "safety/state_machine.hpp"

namespace twinrate {

struct SafetyParameters {
  static constexpr const char* kTable = "safety";
  Off off = Off::kShort;
  std::array<int, kFaultCount> off_at{};  // positions in kOffAtNames
  double v_dc_max = 0, v_dc_min = 0, omega_m_max = 0;
  double temperature_max = 0, temperature_derate = 0;
  double hold_ms = 4;
  bool watch_sensors = true;
  int sensor_ticks = 50;
  double supervisor_ms = 90;  // off within 100 ms
  void fields(FieldVisitor& f);
};

// `hold_ticks`: plant.hold_ticks; the shorter of it and hold_ms applies.
SafetyLimits safety_limits(const Config& config, const SafetyParameters& p, int hold_ticks);
CurrentLimit current_limit(const DriveConfig& drive);
SensorLimits sensor_limits(const DriveConfig& drive, const SafetyLimits& limits);

// One line for a person: "12.3 A, above 6 A: phases shorted".
std::string text_of(const SafetyEvent& event, const SafetyMachine& machine);

}  // namespace twinrate

#include "plant_sim/safety_parameters.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model/per_unit.hpp"

namespace twinrate {
namespace {

constexpr const char* kOffAtNames[] = {"as_off", "short", "open"};

// Two thirds of a voltage step of this share of the bus are dead time, drops and a bus that moves.
constexpr double kVoltageFloor = 0.05;

constexpr double kDerateSpan_K = 20;

// 0 if the drive file gives none.
double controller_limit(const Config& config) {
  const std::string& kind = config.drive().controller.kind;
  return config.given_number("controller." + kind + ".i_max_A").value_or(0);
}

double trip_current(const Config& config) {
  const DriveConfig& d = config.drive();
  if (d.machine.i_trip > 0) return d.machine.i_trip;
  const double i_rated = per_unit(d.machine, d.inverter.v_dc, d.T_s()).i;
  return std::max(4 * i_rated, 2 * controller_limit(config));
}

double fastest(const DriveConfig& d) {
  const double emf = 1.2 * d.inverter.u_max_linear();
  return std::max(d.omega_m_limit(), emf / (d.machine.psi_f * d.machine.n_p));
}

}  // namespace

void SafetyParameters::fields(FieldVisitor& f) {
  f.choice("off", off, kOffNames, "off: phases shorted (zero voltage), or all switches open");
  f.number("v_dc_max_V", v_dc_max, 0, 1e5, "bus voltage above which it is off; 0: 1.3 v_dc_V");
  f.number("v_dc_min_V", v_dc_min, 0, 1e5, "bus voltage below which it is off; 0: 0.5 v_dc_V");
  f.number("omega_m_max_rad_s", omega_m_max, 0, 1e6,
           "mechanical speed above which it is off; 0: twice the fastest of rated speed and "
           "references, and at least the speed whose EMF is 1.2 times the voltage limit");
  f.number("temperature_max_degC", temperature_max, 0, 1000,
           "winding temperature above which it is off; 0: not watched");
  f.number("temperature_derate_degC", temperature_derate, 0, 1000,
           "winding temperature from which on the current limit falls, to zero at "
           "temperature_max_degC; 0: 20 K below it");
  f.number("hold_ms", hold_ms, 0.01, 1e4,
           "time from the tick of the last command to off, at least delay_samples + 2 ticks; "
           "plant.hold_ticks may be shorter");
  f.boolean("watch_sensors", watch_sensors, "replace readings that a healthy sensor cannot give");
  f.integer("sensor_ticks", sensor_ticks, 1, 100000,
            "ticks for which faulty readings are predicted");
  f.number("supervisor_ms", supervisor_ms, 1, 1e5,
           "realtime: silence of the supervisor after which it is off");
  f.table("off_at", [&](FieldVisitor& sub) {
    for (const FaultRow& row : kFaults)
      sub.choice(row.key, off_at[static_cast<std::size_t>(row.fault)], kOffAtNames,
                 "how it is off after this fault; as_off: safety.off");
  });
}

SafetyLimits safety_limits(const Config& config, const SafetyParameters& p, int hold_ticks) {
  const DriveConfig& d = config.drive();
  SafetyLimits limits;
  limits.T_s = d.T_s();
  limits.i_trip = trip_current(config);
  limits.v_dc_max = p.v_dc_max > 0 ? p.v_dc_max : 1.3 * d.inverter.v_dc;
  limits.v_dc_min = p.v_dc_min > 0 ? p.v_dc_min : 0.5 * d.inverter.v_dc;
  limits.omega_m_max = p.omega_m_max > 0 ? p.omega_m_max : fastest(d);
  limits.temperature_max = p.temperature_max;
  limits.temperature_derate =
      p.temperature_derate > 0 ? p.temperature_derate : p.temperature_max - kDerateSpan_K;
  if (p.temperature_max > 0 && limits.temperature_derate >= p.temperature_max)
    throw BadInput(fmt::format(
        "{}: safety.temperature_derate_degC: below temperature_max_degC = {:.4g} allowed, found "
        "{:.4g}",
        config.where("safety.temperature_derate_degC"), p.temperature_max, p.temperature_derate));
  const double i_max = controller_limit(config);
  limits.i_derate = i_max > 0 ? i_max : 0.5 * limits.i_trip;
  // COMMAND(j) acts from t_{j + delay} on, for one tick; off is from t_{j + delay + 1 + hold} on.
  const double in_time_ticks =
      std::floor(1e-3 * p.hold_ms / d.T_s() + 1e-6) - d.plant.delay_samples - 1;
  const auto in_time = static_cast<int>(std::max(1.0, in_time_ticks));
  limits.hold_ticks = std::min(hold_ticks, in_time);
  limits.sensor_ticks = p.sensor_ticks;
  for (std::size_t fault = 0; fault < kFaultCount; ++fault)
    limits.off[fault] = p.off_at[fault] > 0 ? static_cast<Off>(p.off_at[fault] - 1) : p.off;
  return limits;
}

CurrentLimit current_limit(const DriveConfig& d) {
  const MachineParameters& m = d.machine;
  return {.T_s = d.T_s(), .R_s = m.R_s, .L_d = m.L_d, .L_q = m.L_q, .psi_f = m.psi_f};
}

SensorLimits sensor_limits(const DriveConfig& d, const SafetyLimits& limits) {
  const MachineParameters& m = d.machine;
  SensorLimits s;
  s.T_s = d.T_s();
  s.L = std::min(m.L_d, m.L_q);
  s.L_ratio = std::max(m.L_d, m.L_q) / s.L;
  s.R_s = m.R_s;
  s.psi_f = m.psi_f;
  s.n_p = m.n_p;
  s.v_floor = kVoltageFloor * d.inverter.v_dc;
  s.i_floor = std::max(0.05 * limits.i_trip, 8 * d.sensors.i_noise_rms + 2 * d.sensors.i_lsb);
  s.i_sum = d.sensors.current_sensors == 3 ? 0.25 * limits.i_trip + s.i_floor : 0;
  s.i_moved = 0.1 * limits.i_trip;
  const double step = d.sensors.encoder_counts > 0 ? kTwoPi / d.sensors.encoder_counts : 0;
  s.step_max = 2 * limits.omega_m_max * s.T_s + 4 * step;
  return s;
}

std::string text_of(const SafetyEvent& e, const SafetyMachine& machine) {
  const char* off = machine.off() == Off::kOpen ? "gates open" : "phases shorted";
  const auto beyond = [&](const char* what, const char* unit, const char* side) {
    return fmt::format("{} {:.4g} {}, {} {:.4g} {}: {}", what, e.value, unit, side, e.limit, unit,
                       off);
  };
  switch (e.reason) {
    case Reason::kOverCurrent:
      return beyond("current", "A", "above");
    case Reason::kOverVoltage:
      return beyond("bus voltage", "V", "above");
    case Reason::kUnderVoltage:
      return beyond("bus voltage", "V", "below");
    case Reason::kOverSpeed:
      return beyond("speed", "rad/s mechanical", "above");
    case Reason::kOverTemperature:
      return beyond("temperature", "degC", "above");
    case Reason::kDerated:
      return fmt::format("temperature {:.4g} degC, above {:.4g} degC: the current limit falls",
                         e.value, e.limit);
    case Reason::kSensorLost:
      return fmt::format("readings faulty for more than {:.0f} ticks: {}", e.limit, off);
    case Reason::kCommandLost:
      return fmt::format("no command for more than {:.0f} ticks: {}", e.limit, off);
    case Reason::kCommandNotFinite:
      return fmt::format("{:.0f} commands in a row were not finite: {}", e.value, off);
    case Reason::kSafeRequested:
      return fmt::format("the command asked for safe mode: {}", off);
    case Reason::kEmergencyStop:
      return fmt::format("emergency stop: {}", off);
    case Reason::kSupervisorLost:
      return fmt::format("the supervisor is silent: {}", off);
    case Reason::kVoltageClamped:
      return "a command asked for more voltage than the bus gives: applied up to the limit";
    case Reason::kSensorFault:
      return fmt::format("{} predicted",
                         static_cast<int>(e.value) & kAnyCurrentFault    ? "currents"
                         : static_cast<int>(e.value) & kAnyPositionFault ? "angle and speed"
                         : static_cast<int>(e.value) & kRowMissing       ? "a missing row is"
                                                                         : "bus voltage");
    default:
      return fmt::format("{} -> {}", kDriveStateNames[static_cast<int>(e.from)],
                         kDriveStateNames[static_cast<int>(e.to)]);
  }
}

}  // namespace twinrate

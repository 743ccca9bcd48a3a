// Reason codes of DRIVE_EVENT, one table (docs/reason-codes.md is checked against it).
#pragma once
#include <array>

namespace twinrate {

enum class Reason : int {
  kNone = 0,
  kModeChange = 1,
  kStartupGaveUp = 2,
  kLearnt = 3,
  kLostSynchronism = 4,
  kCommandNotFinite = 5,
  kInputNotFinite = 6,
  kEstimateNotFinite = 10,
  kMeasurementGap = 11,
  kEstimatorReset = 12,
  kLateGain = 13,
  kGainScheduled = 14,
  kGainBack = 15,
  kGainEveryNth = 16,
  kLateCommand = 19,
  kCommandLost = 20,
  kOverrun = 21,
  kPlantFailed = 22,
  kPeerTimeout = 30,
  kConfigMismatch = 31,
  kProcessFrozen = 32,
  kLogLost = 33,
  kProcessDied = 34,
  kProcessLost = 35,
  kStopRequested = 40,
  kEmergencyStop = 41,
  kSteered = 42,
  kControlTaken = 43,
  kControlLost = 44,
  kDiskFull = 50,
  kLogRotated = 51,
  kModelMisfit = 60,
  kEffectProposed = 61,
  kEffectAdded = 62,
  kEffectCompared = 63,
  kNothingTraced = 64,
  kEffectRemoved = 65,
  kEffectTakenBack = 66,
  kStateChange = 70,
  kVoltageClamped = 71,
  kOverCurrent = 72,
  kOverVoltage = 73,
  kUnderVoltage = 74,
  kOverSpeed = 75,
  kDerated = 76,
  kOverTemperature = 77,
  kSensorFault = 78,
  kSensorLost = 79,
  kSafeRequested = 80,
  kReset = 81,
  kSecondSender = 82,
  kSupervisorLost = 83,
  kRequestRefused = 84,
  kLinkLost = 90,
  kLinkDisturbed = 91,
  kDeviceReset = 92,
  kDeviceDisobeys = 93,
  kNoDeviceWatchdog = 94,
};

struct ReasonText {
  Reason reason;
  const char* name;
  const char* meaning;
};

inline constexpr std::array kReasons = {
    ReasonText{Reason::kModeChange, "mode_change",
               "the controller changed its mode (alignment, I/f ramp, run)"},
    ReasonText{Reason::kStartupGaveUp, "startup_gave_up",
               "the estimate did not agree with the I/f ramp: zero voltage, safe mode"},
    ReasonText{
        Reason::kLearnt, "learnt",
        "sent at the last tick: the learnt table of the controller, as a table of the drive file"},
    ReasonText{Reason::kLostSynchronism, "lost_synchronism",
               "the estimate lost synchronism with the rotor: zero voltage, safe mode"},
    ReasonText{Reason::kCommandNotFinite, "command_not_finite",
               "a command was not finite: zero voltage, safe mode"},
    ReasonText{Reason::kInputNotFinite, "input_not_finite",
               "measurement or estimate were not finite for 20 ticks: zero voltage, safe mode"},
    ReasonText{Reason::kEstimateNotFinite, "estimate_not_finite",
               "a correction was not finite and was not applied"},
    ReasonText{Reason::kMeasurementGap, "measurement_gap",
               "samples were missing; the filter predicted over them"},
    ReasonText{Reason::kEstimatorReset, "estimator_reset",
               "the sequence started again: the filter restarted"},
    ReasonText{Reason::kLateGain, "late_gain", "a gain was late; the older one was held"},
    ReasonText{
        Reason::kGainScheduled, "gain_scheduled",
        "no new gain for longer than gain.max_age_ticks: the gain comes from the table over speed"},
    ReasonText{Reason::kGainBack, "gain_back",
               "new gains arrive: the fast loop left the table over speed"},
    ReasonText{Reason::kGainEveryNth, "gain_every_nth",
               "the filter agrees with itself: from this tick on a gain is computed every n ticks"},
    ReasonText{Reason::kLateCommand, "late_command",
               "realtime: a command was late; an older one was in force"},
    ReasonText{Reason::kCommandLost, "command_lost",
               "no command for longer than plant.hold_ticks: zero voltage, safe state"},
    ReasonText{Reason::kOverrun, "overrun",
               "realtime: a tick began late by more than half a period; the text says why"},
    ReasonText{Reason::kPlantFailed, "plant_failed", "the integrator reported an error"},
    ReasonText{Reason::kPeerTimeout, "peer_timeout",
               "a process waited longer than bus.peer_timeout_s for another"},
    ReasonText{Reason::kConfigMismatch, "config_mismatch",
               "two processes have different drive files"},
    ReasonText{Reason::kProcessFrozen, "process_frozen",
               "realtime: a process of the set sent no heartbeat"},
    ReasonText{Reason::kLogLost, "log_lost",
               "realtime: the logger ended or stopped; the drive goes on"},
    ReasonText{Reason::kProcessDied, "process_died", "a process of the set ended unexpectedly"},
    ReasonText{Reason::kProcessLost, "process_lost",
               "realtime: a process that the drive does not need ended: the drive goes on"},
    ReasonText{Reason::kStopRequested, "stop_requested", "the run was stopped on request"},
    ReasonText{Reason::kEmergencyStop, "emergency_stop", "emergency stop on request: zero voltage"},
    ReasonText{Reason::kSteered, "steered",
               "a request was applied by all processes from this tick on, KEY=VALUE lines"},
    ReasonText{Reason::kControlTaken, "control_taken",
               "somebody took or gave up the control of the drive"},
    ReasonText{
        Reason::kControlLost, "control_lost",
        "the holder of the control sends no heartbeat: the drive holds, then stops on a ramp"},
    ReasonText{Reason::kDiskFull, "disk_full", "a file of the run could not be written"},
    ReasonText{Reason::kLogRotated, "log_rotated",
               "the log reached its size limit and continues in the next file"},
    ReasonText{
        Reason::kModelMisfit, "model_misfit",
        "the residuals of the drive's equations have left their learnt level: the model no longer "
        "fits"},
    ReasonText{Reason::kEffectProposed, "effect_proposed",
               "the traced effects, as [[effect]] tables of a drive file"},
    ReasonText{Reason::kEffectAdded, "effect_added",
               "a process added an effect to its model, at this tick"},
    ReasonText{Reason::kEffectCompared, "effect_compared",
               "error with and without an added effect, on the data after it"},
    ReasonText{Reason::kNothingTraced, "nothing_traced",
               "the model does not fit, and the monitor names no effect for it"},
    ReasonText{Reason::kEffectRemoved, "effect_removed",
               "a process removed an added effect from its model, at this tick"},
    ReasonText{Reason::kEffectTakenBack, "effect_taken_back",
               "an added effect made the error larger and is removed from the model"},
    ReasonText{Reason::kStateChange, "state_change",
               "the drive changed its state between IDLE, ALIGN, RUN and DERATE"},
    ReasonText{Reason::kVoltageClamped, "voltage_clamped",
               "a command asked for more voltage than the bus gives: applied up to the limit"},
    ReasonText{Reason::kOverCurrent, "over_current",
               "the current was above machine.i_trip_A: off, state SAFE"},
    ReasonText{Reason::kOverVoltage, "over_voltage",
               "the bus voltage was above safety.v_dc_max_V: off, state SAFE"},
    ReasonText{Reason::kUnderVoltage, "under_voltage",
               "the bus voltage was below safety.v_dc_min_V: off, state SAFE"},
    ReasonText{Reason::kOverSpeed, "over_speed",
               "the speed was above safety.omega_m_max_rad_s: off, state SAFE"},
    ReasonText{Reason::kDerated, "derated",
               "the temperature reduces the current limit: state DERATE"},
    ReasonText{Reason::kOverTemperature, "over_temperature",
               "the temperature was above its limit: off, state SAFE"},
    ReasonText{Reason::kSensorFault, "sensor_fault",
               "a reading was not finite, stuck or jumped: it is predicted"},
    ReasonText{Reason::kSensorLost, "sensor_lost",
               "readings were faulty for longer than safety.sensor_ticks: off, state SAFE"},
    ReasonText{Reason::kSafeRequested, "safe_requested",
               "a command asked for safe mode: off, state SAFE"},
    ReasonText{Reason::kReset, "reset", "a request took the drive from SAFE to IDLE"},
    ReasonText{Reason::kSecondSender, "second_sender",
               "a second sender of a channel or role was refused, or a second command of a tick"},
    ReasonText{Reason::kSupervisorLost, "supervisor_lost",
               "realtime: the supervisor sent no heartbeat: off, state SAFE"},
    ReasonText{Reason::kRequestRefused, "request_refused",
               "a request was refused: no valid tag, a repeat, or a sender without permission"},
    ReasonText{Reason::kLinkLost, "link_lost",
               "no frame of the drive for longer than bridge.silence_ms: off"},
    ReasonText{Reason::kLinkDisturbed, "link_disturbed",
               "frames of the drive were damaged, lost, doubled or late: they are counted"},
    ReasonText{Reason::kDeviceReset, "device_reset",
               "the drive restarted in mid-run: off, and no command until the next run"},
    ReasonText{Reason::kDeviceDisobeys, "device_disobeys",
               "the drive applies a voltage although it was switched off"},
    ReasonText{Reason::kNoDeviceWatchdog, "no_device_watchdog",
               "the drive keeps its last command if the host ends: not safe"},
};

// Events after which the motor is not controlled: the drive has zero voltage, or its run ended.
constexpr bool is_trip(Reason reason) {
  switch (reason) {
    case Reason::kStartupGaveUp:
    case Reason::kLostSynchronism:
    case Reason::kCommandNotFinite:
    case Reason::kInputNotFinite:
    case Reason::kCommandLost:
    case Reason::kPlantFailed:
    case Reason::kPeerTimeout:
    case Reason::kConfigMismatch:
    case Reason::kProcessDied:
    case Reason::kEmergencyStop:
    case Reason::kDiskFull:
    case Reason::kOverCurrent:
    case Reason::kOverVoltage:
    case Reason::kUnderVoltage:
    case Reason::kOverSpeed:
    case Reason::kOverTemperature:
    case Reason::kSensorLost:
    case Reason::kSafeRequested:
    case Reason::kSupervisorLost:
    case Reason::kLinkLost:
    case Reason::kDeviceReset:
    case Reason::kDeviceDisobeys:
      return true;
    default:
      return false;
  }
}

// Trips that end a process of the set or come from its user. They do not apply to a drive that this
// host does not command.
constexpr bool is_of_own_set(Reason reason) {
  switch (reason) {
    case Reason::kPeerTimeout:
    case Reason::kConfigMismatch:
    case Reason::kProcessDied:
    case Reason::kEmergencyStop:
    case Reason::kDiskFull:
    case Reason::kSupervisorLost:
      return true;
    default:
      return false;
  }
}

// The name of a code in kReasons; nullptr for an unknown code.
constexpr const char* reason_name(int code) {
  for (const ReasonText& text : kReasons)
    if (static_cast<int>(text.reason) == code) return text.name;
  return nullptr;
}

}  // namespace twinrate

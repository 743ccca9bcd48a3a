// The safety state machine of a drive.
//
//   IDLE    no command has been applied yet, or none but safe mode  zero voltage
//           since a reset
//   ALIGN   the command forces the angle (alignment, I/f ramp)
//   RUN     the command controls the motor
//   DERATE  as RUN, with a reduced current limit (temperature): safety/current_limit.hpp
//   SAFE    off: phases shorted or gates open, by fault; latched until reset()
//
// Reactions, in ticks of the drive:
//
//   COMMAND missing             the last voltage is held for hold_ticks, then off; IDLE waits
//   COMMAND not finite          the last voltage is held, off at the second in a row
//   voltage beyond the bus      applied up to the limit by the modulator, event
//   |i| > i_trip                off at the second sample in a row
//   v_dc out of its limits      off at once
//   |omega_m| > omega_m_max     off, after a low-pass of kSpeedLowpass_s: the speed of an encoder
//                               is a difference of two angles
//   temperature                 DERATE from temperature_derate on, off above temperature_max
//   readings faulty             off after sensor_ticks in a row
//   safe mode, emergency stop, silent supervisor: off at once
//
// Every change of state is an event with its reason code (core/reason.hpp). One step a tick.
#pragma once
#include <cstdint>

#include "safety/limits.hpp"

namespace twinrate {

enum class DriveState : int { kIdle, kAlign, kRun, kDerate, kSafe };
inline constexpr const char* kDriveStateNames[] = {"IDLE", "ALIGN", "RUN", "DERATE", "SAFE"};

// Arrival of the command that is due at a tick.
enum class Arrival : int { kNotDue, kInTime, kMissing, kNotFinite };
// The request in that command.
enum class Asked : int { kRun, kForcedAngle, kSafe };

struct SafetyInput {
  Arrival arrival = Arrival::kNotDue;
  Asked asked = Asked::kRun;  // of the command in force
  bool clamped = false;       // it asks for more voltage than the bus gives
  int faulty = 0;             // readings that are predicted (ReadingFault of sensor_watch.hpp)
  double i = 0;               // amplitude of the current vector, A
  double v_dc = 0;            // V
  double omega_m = 0;         // rad/s
  bool has_temperature = false;
  double temperature = 0;  // degC
  bool emergency_stop = false, supervisor_silent = false;
  bool reset = false;  // leave SAFE before this tick, if its readings allow it
};

struct SafetyEvent {
  Reason reason = Reason::kNone;
  DriveState from = DriveState::kIdle, to = DriveState::kIdle;
  double value = 0, limit = 0;  // in the unit of the limit; ticks for a missing command or reading
};

class SafetyMachine {
 public:
  static constexpr double kSpeedLowpass_s = 2e-3;
  static constexpr int kOverCurrentTicks = 2, kNotFiniteTicks = 2;
  // Clamping that pauses for less than this is one event.
  static constexpr double kClampPause_s = 0.1;

  explicit SafetyMachine(const SafetyLimits& limits) : limits_(limits) {}

  // Of tick k, before its voltage is applied. Its events stay until the next step.
  void step(const SafetyInput& in);
  // SAFE -> IDLE. False in another state, or if the last step's readings would trip again.
  bool reset();
  bool may_reset() const;

  DriveState state() const { return state_; }
  bool is_off() const { return state_ == DriveState::kSafe; }
  Off off() const { return off_; }
  // Share of the current limit that DERATE leaves, 1 in every other state.
  double current_share() const { return current_share_; }
  int event_count() const { return event_count_; }
  const SafetyEvent& event(int i) const { return events_[static_cast<std::size_t>(i)]; }
  const SafetyLimits& limits() const { return limits_; }

 private:
  void count(const SafetyInput& in);
  template <Fault fault>
  bool trips(const SafetyInput& in, double& value, double& limit) const;
  // Row of kFaults.
  template <std::size_t row>
  bool goes_off(const SafetyInput& in);
  bool leave_safe();
  void go_off(Fault fault, double value, double limit);
  void follow_command(const SafetyInput& in);
  void derate(const SafetyInput& in);
  void step_on(const SafetyInput& in);  // of a drive that is not off
  void change_to(DriveState state, Reason reason, double value = 0, double limit = 0);
  void add_event(const SafetyEvent& event);

  SafetyLimits limits_;
  DriveState state_ = DriveState::kIdle;
  Off off_ = Off::kShort;
  double current_share_ = 1;
  int missing_ticks_ = 0, not_finite_ticks_ = 0, over_current_ticks_ = 0, faulty_ticks_ = 0;
  int faulty_before_ = 0;
  double omega_m_ = 0;
  bool speed_known_ = false;
  double since_clamped_s_ = 1;
  std::array<SafetyEvent, 4> events_{};  // clamped, sensor fault, change of state, one to spare
  int event_count_ = 0;
  SafetyInput last_;
};

}  // namespace twinrate

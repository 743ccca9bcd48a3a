// The host's own protection of a real drive: the state machine of safety/ on the received samples,
// in addition to the one in the drive.
//
//   sample     readings that a healthy sensor cannot give (safety/sensor_watch.hpp), |i|, v_dc, speed
//   command    missing for hold_ticks (a lost estimator sends none), not finite, safe mode
//   drive      off by itself, restarted, or driving although it was switched off
//   link       silent for bridge.silence_ms
//
// Off: the host sends only off frames. Off is latched for the rest of the run.
#pragma once
#include <string>
#include <vector>

#include "bridge/host_protocol.hpp"
#include "core/reason.hpp"
#include "plant_sim/safety_parameters.hpp"

namespace twinrate {

struct GuardEvent {
  Reason reason = Reason::kNone;
  std::string text;
};

class BridgeGuard {
 public:
  // Ticks for which a drive may still show a voltage after the first off frame: link and delay.
  static constexpr int kObeyTicks = 100;

  BridgeGuard(Config& config, const BridgeParameters& bridge);

  // Takes a sample and the arrival of the command that was due with it. Returns the measurement for
  // the processes: a faulty reading is predicted and marked as not measured, as in the simulated drive.
  Measurement take(const DriveSample& sample, Arrival command, Mode mode);
  void restarted() { go_off(Reason::kDeviceReset, "the drive restarted in mid-run: off"); }
  void silent_for(double silent_ms);
  void emergency_stop() { stop_ = true; }
  void supervisor_is_silent() { supervisor_silent_ = true; }

  bool is_off() const { return off_; }
  // Since the last call.
  std::vector<GuardEvent> take_events();

 private:
  void go_off(Reason reason, const std::string& text);
  void watch_obedience(const DriveSample& sample);
  // Readings that a healthy sensor cannot give are predicted. Sum of ReadingFault.
  int watch_readings(Measurement& m);

  double silence_ms_, v_dc_nominal_;
  SafetyMachine machine_;
  SensorWatch watch_;
  bool needs_position_, off_ = false, stop_ = false, supervisor_silent_ = false;
  bool device_was_off_ = false, disobeyed_ = false;
  int ticks_off_ = 0;
  std::vector<GuardEvent> events_;
};

}  // namespace twinrate

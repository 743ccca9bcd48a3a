// The trigger: watches one signal or the events tick by tick and finds the tick at which it fires.
//
//   rising:   armed once the signal is below level - hysteresis, fires at the first tick >= level
//   falling:  armed once it is above level + hysteresis, fires at the first tick <= level
//   change:   fires at the first tick whose value differs from that of the tick before, after
//             kSteadyTicks equal ones (a step, or the start of a ramp, of a reference)
//
// After a capture of length_ticks the trigger waits for holdoff_ticks more. Mode `single` fires once.
// Mode `automatic` also fires by itself after automatic_ticks without a trigger.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

namespace twinrate::scope {

enum class TriggerMode { kStop, kAutomatic, kNormal, kSingle };
enum class Edge { kRising, kFalling, kEither, kChange };
inline constexpr const char* kTriggerModeNames[] = {"stop", "auto", "normal", "single"};
inline constexpr const char* kEdgeNames[] = {"rising", "falling", "either", "change"};
inline constexpr std::int64_t kSteadyTicks = 16;

struct TriggerSettings {
  TriggerMode mode = TriggerMode::kStop;
  std::string signal;  // a name of the SignalTable; "" if an event is the source
  std::string event;   // a name of kReasons, "trip" or "any"; "" if a signal is the source
  Edge edge = Edge::kRising;
  double level = 0, hysteresis = 0;
  double pre_share = 0.5;  // part of the capture before the trigger, 0 to 1
  std::int64_t length_ticks = 1000, holdoff_ticks = 0;
  std::int64_t automatic_ticks = 5000;  // mode auto: fires after this many ticks at the latest
};

class Trigger {
 public:
  void set(TriggerSettings settings);
  const TriggerSettings& settings() const { return settings_; }
  bool armed() const { return settings_.mode != TriggerMode::kStop; }

  // The signal's value at tick k. True: fired at k.
  bool sample(std::int64_t k, double value);
  // An event at tick k. True: fired at k.
  bool event(std::int64_t k, const std::string& name, bool trip);
  // Mode automatic: true if it fires by itself at k.
  bool automatic(std::int64_t k);
  // Fires at k, in every mode. A stopped trigger stays stopped.
  void force(std::int64_t k) { fire(k); }

 private:
  bool crosses(double value);
  bool held_off(std::int64_t k) const { return k < ready_from_; }
  bool fire(std::int64_t k);

  TriggerSettings settings_;
  std::int64_t last_k_ = -1, ready_from_ = 0, waiting_since_ = -1, steady_ = 0;
  double last_ = 0;
  bool below_ = false, above_ = false;  // armed for a rising, a falling edge
};

}  // namespace twinrate::scope

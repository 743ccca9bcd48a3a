// Access to a running drive: sends requests and waits for the answer of the plant, which decides
// for the whole set (core/arbiter.hpp). `twinrate set` and the page use it.
//
//   DriveHand hand(find_running_set(""), "page");
//   hand.take_control();                       others can only stop the drive from now on
//   hand.steer("speed_rpm=1000\nload_Nm=0.1")   -> the tick from which on both hold
//   .. hand.beat() at least every kBeat_s; a silent holder loses the control
//   hand.give_control();
//
// Belongs to one thread. Without a holder's name each request is independent.
#pragma once
#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "core/authority.hpp"
#include "core/bus.hpp"

namespace twinrate {

struct HandAnswer {
  bool answered = false, accepted = false;
  std::int64_t k = -1;    // first tick that it holds at
  std::int64_t t_ns = 0;  // its drive time
  std::string why;        // reason of a refusal or of a missing answer
  double waited_s = 0;    // from the request to the answer
};

class DriveHand {
 public:
  static constexpr double kBeat_s = 0.25, kRepeat_s = 0.05;
  static constexpr int kMostAtOnce = 1000;  // messages that a beat reads

  // Throws as Bus.
  explicit DriveHand(const RunningSet& set, std::string holder = "", double patience_s = 3);

  // `lines`: core/steering.hpp. `tick`: 0: the next one that all processes can keep.
  HandAnswer steer(const std::string& lines, std::int64_t tick = 0);
  // These do not ask who has control.
  HandAnswer stop() { return ask(RequestKind::kSteer, "stop"); }
  HandAnswer emergency_stop() { return ask(RequestKind::kEmergencyStop); }
  HandAnswer reset() { return ask(RequestKind::kReset, holder_line()); }
  // [[effect]] tables.
  HandAnswer add_effect(const std::string& toml) {
    return ask(RequestKind::kAddEffect, holder_line() + toml);
  }
  HandAnswer remove_effect(const std::string& toml) {
    return ask(RequestKind::kRemoveEffect, holder_line() + toml);
  }

  HandAnswer take_control();
  HandAnswer give_control();
  // The heartbeat of the holder; sends one when it is due and does not wait. It keeps the control and
  // does not take it again once it was lost.
  void beat();
  // As the drive answered last.
  bool has_control() const { return has_control_; }
  // Handles the messages that have arrived, for users of bus().
  Bus& bus() { return bus_; }

  HandAnswer ask(RequestKind kind, const std::string& text = "", std::int64_t tick = 0);

 private:
  void wait_for_session();
  std::string holder_line() const;

  std::string holder_;
  double patience_s_;
  Bus bus_;
  std::int64_t asked_ = 0;   // number of the request that waits for its answer
  std::int64_t beaten_ = 0;  // of the last heartbeat
  bool has_control_ = false;
  HandAnswer answer_;
  std::chrono::steady_clock::time_point beat_at_{};
};

}  // namespace twinrate

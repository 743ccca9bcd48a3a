// One tick for all processes: the plant makes a request take effect at the same tick in each of
// them.
//
//   asker -> plant   the request, repeated until the plant answers
//   plant -> others  prepare: each process checks the request and agrees, or gives the reason why
//                    not
//   plant -> others  apply at T, repeated until each has confirmed
//   plant -> asker   applied at T; or, once all have replied, refused with the first reason given
//
// In lock-step T is the first tick that the plant has not begun, or a later requested one, at most
// kAhead_s later. Nothing of tick T exists before MEASUREMENT(T), and the plant does not send it
// before every process has answered. So T is common in spite of lost or late messages, and a silent
// process ends the run as at any tick. In realtime nobody waits: T is kMargin_s ahead, and a
// process that has not answered by then is named in the reply, which refuses the request.
//
// Requests are handled one after another: prepare, apply and drop come from the plant alone. A
// repeated request gets the same answer.
//
// Control: at most one holder, who sends a heartbeat. While there is one, requests of others are
// refused, except stop and the monitor's own changes of the model. A holder is identified by name
// and socket, the monitor by the socket of its role: a sender with the name alone is not the
// holder. A holder that is silent for kSilent_s is reported; steering.hold_s later the drive is
// stopped on a ramp. Without a holder every request is allowed.
#pragma once
#include <chrono>
#include <deque>
#include <functional>
#include <optional>
#include <set>
#include <string>

#include "core/channels.hpp"
#include "core/reason.hpp"

namespace twinrate {

class Arbiter {
 public:
  static constexpr double kRepeat_s = 0.02, kPatience_s = 2, kMargin_s = 0.2, kSilent_s = 1,
                          kAhead_s = 60;
  // The first line of a request of the holder, before the KEY=VALUE lines or [[effect]] tables.
  static constexpr const char* kHolderLine = "holder=";
  static constexpr const char* kMonitor = "monitor";  // whose changes of the model need no control

  // Who asks, as the bus knows it.
  struct Asker {
    std::uint64_t socket = 0;  // 0: not known
    bool is_monitor = true;    // if known
  };
  // The functions of its process that the arbiter uses.
  struct Host {
    std::function<std::int64_t()> next_tick;        // the first one that has not begun
    std::int64_t ticks = 0;                         // of the run
    std::int64_t margin_ticks = 0;                  // realtime; 0: lock-step, the host holds
    std::int64_t ahead_ticks = INT64_MAX;           // kAhead_s
    double hold_s = 1;                              // steering.hold_s
    std::function<std::set<int>()> members;         // roles that have to agree. Throws BadInput
    std::function<void(const request_t&)> prepare;  // this process. Throws BadInput
    std::function<void(const request_t&)> apply;
    std::function<void(request_t)> ask;
    std::function<void(reply_t)> answer;
    std::function<void(Reason, std::int64_t k, const std::string&)> event;
    std::function<void()> released;         // the held tick may begin
    std::function<void()> refused = [] {};  // a request without control was refused
  };
  explicit Arbiter(Host host) : host_(std::move(host)) {}

  void take(const request_t& request, const Asker& asker);
  void take(const reply_t& reply);
  // Repeats and time-outs; often.
  void turn();
  // True while the host must not begin tick k.
  bool holds(std::int64_t k) const {
    return host_.margin_ticks == 0 && phase_ == Phase::kApplying && k >= tick_;
  }
  const std::string& holder() const { return holder_; }

 private:
  using Clock = std::chrono::steady_clock;
  enum class Phase { kIdle, kGathering, kPreparing, kApplying };

  void control(const request_t& request, const Asker& asker);
  std::string not_allowed(request_t& request, const Asker& asker) const;
  bool is_holder(const std::string& name, const Asker& asker) const;
  void begin(request_t request);
  void gather();
  void begin_applying();
  void refuse(const std::string& why);
  void done();
  void finish(reply_t reply);
  void send_phase();
  void watch_holder();

  Host host_;
  Phase phase_ = Phase::kIdle;
  request_t request_{};
  std::set<int> members_, replied_;
  std::optional<std::string> refusal_;  // the first one, given when all have replied
  std::int64_t tick_ = 0;
  Clock::time_point begun_{}, sent_{};
  std::deque<reply_t> answered_;
  std::string holder_;
  std::uint64_t holder_socket_ = 0;
  Clock::time_point holder_heard_{};
  std::int64_t holder_beat_ns_ = 0;  // t_ns of the holder's last request
  bool silent_ = false;
};

// The KEY=VALUE lines of a request without its holder.
std::string without_holder(const std::string& text, std::string* holder = nullptr);

}  // namespace twinrate

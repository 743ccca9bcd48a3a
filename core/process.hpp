// The common parts of every process of the set: command line, config, bus, heartbeat, stop signals,
// waiting with a limit.
//
//   int main(int argc, char** argv) {
//     return twinrate::run_process(
//         {Role::kGain, "twinrate-gain", "ESTIMATE -> [background_step] -> GAIN"}, argc, argv,
//         [](Process& p) { .. subscribe, p.ready(), p.run(); });
//   }
//
// Exit codes: 0 done or stopped on request, 1 the run ended badly, 2 bad input, 3 the machine
// cannot do the task.
#pragma once
#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/arbiter.hpp"
#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/config.hpp"
#include "core/reason.hpp"
#include "core/steering.hpp"
#include "core/worker.hpp"

namespace twinrate {

struct ProcessOptions {
  std::string config, url, channel_suffix, run_dir, token_file, shared_memory;
  std::vector<std::string> overrides;
  std::int64_t session = 0;
  Pace pace = Pace::kLockstep;
  bool wall = false;  // plant: lock-step, but not ahead of the wall clock
  bool follow = false;
  bool wait_for_start = false;  // plant: hold until DRIVE_REQUEST start
  bool resume = false;          // logger: continues the log of an earlier one in its next part
  int cpu = -1;                 // pin to this CPU
  int helper_cpu = -1;          // lock-step: for messages that nobody waits for
};

// Messages of a channel that every process keeps for sending again, beyond bus.window_ticks.
inline constexpr int kKeptBeyondWindow = 1024;

// Name of the text of a request for effects in a refusal.
inline constexpr const char* kEffectsSource = "DRIVE_REQUEST";

struct ProcessInfo {
  Role role;
  const char* program;
  const char* purpose;
  double drain_every_ms = 0;  // above 0: nobody waits for it (BusOptions)
};

// Time that a process waits beyond bus.peer_timeout_s, by the awaited message, the shortest first.
// If one process of a ring is silent, all others wait, each for its neighbour. The neighbour of the
// silent process gives up first, so that the silent one is named, whichever it is.
enum class Patience : int {
  kForGain,
  kForEstimate,  // TRUTH and REFERENCE likewise
  kForCommand,   // the acknowledgement of the log likewise
  kForMeasurement,
  kForSnapshot,
  kForWholeTicks,
};

// The awaited message and its sender; no sender if it is not a process of the set.
struct Waiting {
  std::string message;
  Patience patience = Patience::kForGain;
  std::optional<Role> from = {};
  std::string text() const {
    return from ? message + " from " + kRoleNames[static_cast<int>(*from)] : message;
  }
};

class Process {
 public:
  Process(const ProcessInfo& info, ProcessOptions options);

  const ProcessOptions& options() const { return options_; }
  Config& config() { return config_; }
  const DriveConfig& drive() const { return config_.drive(); }
  Bus& bus() { return *bus_; }
  status_t& status() { return status_; }
  bool lockstep() const { return options_.pace == Pace::kLockstep; }
  // In a launched lock-step set every message answers the one before: one of a later tick cannot be
  // genuine. A log player may leave ticks out; its peers follow.
  bool in_turn() const { return lockstep() && bus_->bound() && !options_.follow; }

  // Reports on the bus that all subscriptions are made.
  void ready();
  // One turn of the loop: handles the received messages and sends the heartbeat. False once the
  // process must stop. A bound process without progress() for bus.peer_timeout_s reports the
  // awaited message and stops.
  bool turn(double timeout_ms);
  // turn() until the end, calling `on_quiet` whenever nothing arrived for repeat_after_ms.
  void run(const std::function<void()>& on_quiet = {});
  void progress(std::int64_t k);
  // The awaited message, for the text of a time-out.
  void waiting_for(std::function<Waiting()> waiting) { waiting_for_ = std::move(waiting); }

  // Action of an emergency stop in this process (the plant: zero voltage).
  void on_emergency_stop(std::function<void()> action) { emergency_stop_ = std::move(action); }

  // A reset: from tick `k` on the plant leaves SAFE, estimator and controller restart. Returns ""
  // or the reason why it is impossible. With k = kNoTick it only checks.
  static constexpr std::int64_t kNoTick = INT64_MAX;
  using Reset = std::function<std::string(std::int64_t k)>;
  void on_reset(Reset action) { reset_ = std::move(action); }

  // Seconds since the supervisor's last heartbeat; empty before the first (no supervisor).
  std::optional<double> supervisor_silent_s() const;

  // The plant: time in which the machine did not run it is no silence of the supervisor.
  void clock_stood(std::int64_t ns);

  // Handles a request for more or fewer effects in the model: `extended` is this drive with all
  // effects that were added and not removed. The function builds the parts that the process needs
  // and returns a function that uses them from tick `k` on. In realtime the first runs on a thread
  // of its own, and only the second between two ticks. May throw BadInput, which refuses the
  // request. A process without a model does not call this.
  using UseModel = std::function<void(std::int64_t k)>;
  using NewModel = std::function<UseModel(Config& extended)>;
  void on_new_model(NewModel build);

  // Steering in this process. `check` may throw BadInput, which refuses the request; `k`: the first
  // possible tick; in realtime on a thread of its own. `follow` takes over the drive with the new
  // steps.
  struct Follower {
    std::function<void(const SteeredDrive& wanted, std::int64_t k)> check;
    std::function<void(const SteeredDrive& now)> follow;
  };
  void on_steering(Follower follower) { follower_ = std::move(follower); }
  // Called with the applied lines and their tick, also for effects.
  void on_applied(std::function<void(const std::string& lines, std::int64_t k)> action) {
    applied_action_ = std::move(action);
  }
  // The plant: decides on the tick of every request. `next_tick`: the first one that it has not
  // begun; `released`: it may continue.
  void arbitrate(std::function<std::int64_t()> next_tick, std::function<void()> released);
  // True while tick k must not begin.
  bool holds(std::int64_t k) const { return arbiter_ && arbiter_->holds(k); }

  // The monitor: requests the addition of its proposal; false without a proposal.
  void on_add_proposed(std::function<bool(const std::string& text)> action) {
    add_proposed_ = std::move(action);
  }

  // At this rate gains are expected, so that missing ones can be counted.
  void gains_every_nth(BackgroundRate rate) { gain_rate_ = rate; }
  const SteeredDrive& steered() const { return steered_; }

  void event(Reason reason, std::int64_t k, const std::string& text,
             std::optional<Role> waited_for = {});
  void finish(ProcessState state = ProcessState::kDone);
  void fail(Reason reason, std::int64_t k, const std::string& text,
            std::optional<Role> waited_for = {});
  bool stopping() const;
  int exit_code() const { return status_.state == static_cast<int>(ProcessState::kFailed) ? 1 : 0; }
  const BusParameters& bus_parameters() const { return bus_parameters_; }
  double repeat_after_ms() const { return bus_parameters_.repeat_after_ms; }

 private:
  using Clock = std::chrono::steady_clock;
  // False if this process sends no reply: another process answers, or the reply comes later.
  bool answer(const request_t& request, reply_t& reply);
  bool start();
  bool emergency_stop(reply_t& reply);
  bool answer_reset(const request_t& request, reply_t& reply);
  bool answer_model_change(const request_t& request, reply_t& reply);
  void handle_request(const request_t& request);
  bool is_recorded(const request_t& request);
  bool is_of_the_plant() const;  // the request that is being handled
  Arbiter::Asker asker() const;
  // Fills in the result of the request; a repeated request gets the same answer.
  void change_model(const request_t& request, reply_t& reply);
  void reset(const request_t& request, reply_t& reply);
  // The tick that a request names, or the next one.
  std::int64_t tick_of(const request_t& request) const;
  Config changed_model(const request_t& request, std::int64_t last_k) const;
  std::size_t declared_effects() const;
  bool must_be_arbitrated() const;
  std::set<int> members() const;
  // A request that this process has checked.
  struct Prepared {
    request_t request;  // kind and text as the asker sent them
    std::optional<Config> changed = {};
    UseModel use = {};
    std::string refusal = {};
  };
  Prepared prepared(const request_t& request, std::int64_t last_k);  // throws BadInput
  Prepared prepared_or_refused(const request_t& request, std::int64_t last_k);
  // Null while it is built.
  const Prepared* prepare(const request_t& request);
  void take_built();
  void apply_prepared(std::int64_t k);
  reply_t answer_of(const Prepared& prepared) const;
  reply_t reply_to(const request_t& request) const;
  // False if the request was not prepared here.
  bool answer_arbiter(const request_t& request, reply_t& reply);
  void compare_config(const status_t& other);
  void beat();
  double spin_us();
  void set_up_realtime();
  void expect_restarted(const event_t& event);
  void hear_supervisor(const status_t& beat);
  void leave_to(const status_t& twin);
  void note_second(const Bus::SecondSender& second);
  void note_refused(std::int64_t& count);
  void log_refused();
  void check_patience();
  void check_supervisor();

  ProcessInfo info_;
  ProcessOptions options_;
  Config config_;
  BusParameters bus_parameters_;
  SteeredDrive steered_;
  RateHistory rates_;         // of steered_
  BackgroundRate gain_rate_;  // for the count of missing gains, up to the first change
  std::unique_ptr<Bus> bus_;
  status_t status_{};
  Clock::time_point last_beat_{}, last_progress_{}, ready_{};
  // Requests that were refused since the last event: without a valid tag; heard before; a phase of
  // the plant's from somebody else; while another has control.
  std::int64_t untagged_ = 0, recorded_ = 0, foreign_ = 0, not_holder_ = 0;
  Clock::time_point refused_named_{};
  std::set<SocketName> seconds_;  // second senders that were named
  // By kind and number: the sender's time of the last received one; the oldest first.
  using RequestName = std::pair<std::int32_t, std::int64_t>;
  std::map<RequestName, std::int64_t> requests_heard_;
  std::deque<RequestName> requests_in_order_;
  std::int64_t supervisor_beats_ = 0;
  std::function<Waiting()> waiting_for_;
  std::function<void()> emergency_stop_;
  Reset reset_;
  std::optional<reply_t> reset_answer_;  // to the last request for a reset
  std::optional<Clock::time_point> supervisor_heard_;
  NewModel new_model_;
  Follower follower_;
  std::function<void(const std::string&, std::int64_t)> applied_action_;
  std::optional<Arbiter> arbiter_;
  std::map<int, Clock::time_point> heard_;  // processes of the set that have not ended, by role
  std::optional<Prepared> prepared_, built_, spent_;
  std::unique_ptr<Worker> builder_;  // realtime: of built_
  std::int64_t applied_request_ = 0, applied_k_ = -1;
  std::function<bool(const std::string& text)> add_proposed_;
  std::optional<Config> extended_;     // with the effects that requests added and did not remove
  std::int64_t planned_until_k_ = -1;  // the last tick at which the drive file changes the model
  std::vector<std::pair<std::string, reply_t>> effects_answered_;  // by the request's text
  bool finished_ = false;
};

// Parses the command line, runs `body`, turns every exception into one line and an exit code.
int run_process(const ProcessInfo& info, int argc, char** argv,
                const std::function<void(Process&)>& body);

// From now on SIGINT and SIGTERM set a flag instead of ending the program.
void catch_stop_signals();
bool stop_signalled();
// Pins the calling process (all later threads too) to one CPU; before the first subscribe.
void pin_to_cpu(int cpu);

}  // namespace twinrate

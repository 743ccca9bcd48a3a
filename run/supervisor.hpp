// Runs one process set from start to end and collects its counts.
#pragma once
#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "core/bridge_parameters.hpp"
#include "core/bus.hpp"
#include "core/logger_parameters.hpp"
#include "core/process.hpp"
#include "core/process_set.hpp"
#include "core/realtime_parameters.hpp"
#include "core/recent.hpp"
#include "core/shared_ring.hpp"
#include "run/links.hpp"
#include "run/progress.hpp"
#include "run/run_result.hpp"

namespace twinrate {

// A command that plays these roles in the place of the set's programs; it is started with the options
// of the first one.
struct OwnProgram {
  std::vector<Role> roles;
  std::vector<std::string> command;
};

struct SuperviseOptions {
  std::string directory;  // holds config.toml
  std::string url, channel_suffix;
  Pace pace = Pace::kLockstep;
  bool wall = false;  // lock-step, but not ahead of the wall clock
  bool json = false;
  bool monitor = false;    // twinrate-monitor runs with the set
  std::set<Role> without;  // started by the user: the set waits for them
  std::vector<OwnProgram> own;
  BusParameters bus;
  BridgeParameters bridge;  // where plant.kind = bridge
  OnLoss on_log_loss = OnLoss::kStop;
  RealtimeParameters realtime;
};

class Supervisor {
 public:
  Supervisor(const DriveConfig& drive, SuperviseOptions options);
  // Starts the set, waits until every process is ready, starts the plant, waits for its end and
  // stops the other processes.
  RunFacts run();

 private:
  void start_own();
  void start_children();
  bool is_own(Role role) const;
  void start_emulator();
  bool listens() const;
  bool shadows(Role role) const;
  void say_how_to_start(Role role) const;
  bool wait_for_own_processes();
  bool wait_until_ready();
  std::string set_up_realtime() const;
  void open_bus();
  void count_messages();
  void watch();
  LiveCounters live_counters() const;
  bool continues_without(Role role);
  bool can_spare(Role role) const;
  bool start_again(Role role);
  void beat();
  void measure_links();
  std::vector<Role> watched() const;
  void stop_own_processes();
  void look_for_silence();
  void note_silence(Role role, double silent_s);
  void publish_event(Reason reason, const std::string& text, std::optional<Role> waited_for = {});
  void stop_in_order();
  void note_status(const status_t& status);
  void note_dead_child();
  void request(RequestKind kind);
  void note_failure(const event_t& event);
  bool has_failed(int role) const;
  std::string root_cause() const;
  bool end_early(const std::string& why);
  std::vector<std::string> arguments(Role role) const;

  DriveConfig drive_;
  SuperviseOptions options_;
  std::int64_t session_;
  std::optional<TokenFile> token_;      // while the run is on
  std::optional<SharedMemory> memory_;  // bus.shared_memory
  ProcessSet set_;
  std::unique_ptr<Bus> bus_;
  Progress progress_;
  Links links_;                     // to the processes that the user starts
  std::map<int, status_t> latest_;  // by role
  bool pinned_ = false;
  std::int64_t requests_ = 0, beats_ = 0;
  const char* pace_name() const {
    return options_.wall ? "wall" : kPaceNames[static_cast<int>(options_.pace)];
  }
  // truth_ and estimate_ are those of one tick.
  template <class Signal>
  void pair(std::int64_t k, Recent<Signal>& kept, const Signal& signal) {
    kept.put(signal);
    const Truth* truth = truths_.at(k);
    const Estimate* estimate = estimates_.at(k);
    if (truths_.empty() && estimate) estimate_ = *estimate;  // a real drive
    if (!truth || !estimate || k <= estimate_.k) return;
    truth_ = *truth;
    estimate_ = *estimate;
  }
  Recent<Truth> truths_;
  Recent<Estimate> estimates_;
  Truth truth_;
  Estimate estimate_;
  RunFacts facts_;
  bool frozen_ = false;     // the run ended because a process beat no more
  bool all_ready_ = false;  // the drive files were compared
  std::set<Role> ended_;    // whose end was reported while the drive goes on
  // Realtime: the last heartbeat of each process, and whose silence was reported.
  std::map<int, std::chrono::steady_clock::time_point> heard_;
  std::set<Role> silent_;
  std::map<Role, int> restarts_;
  std::set<Role> rejoining_;  // started again, and not heard yet
  std::chrono::steady_clock::time_point last_beat_{}, last_turn_{};
  std::vector<event_t> failures_;  // the first one of each process, in the order heard
};

}  // namespace twinrate

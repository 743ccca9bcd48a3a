// Runs one process set from start to end and collects its counts.
#pragma once
#include <chrono>
#include <map>
#include <set>
#include <string>

#include "core/bus.hpp"
#include "core/logger_parameters.hpp"
#include "core/process.hpp"
#include "core/process_set.hpp"
#include "run/progress.hpp"
#include "run/run_result.hpp"

namespace twinrate {

struct SuperviseOptions {
  std::string directory;  // holds config.toml
  std::string url, channel_suffix;
  Pace pace = Pace::kLockstep;
  bool json = false;
  bool monitor = false;  // twinrate-monitor runs with the set
  BusParameters bus;
  OnLoss on_log_loss = OnLoss::kStop;
};

class Supervisor {
 public:
  Supervisor(const DriveConfig& drive, SuperviseOptions options);
  // Starts the set, waits until every process is ready, starts the plant, waits for its end and
  // stops the other processes.
  RunFacts run();

 private:
  void start_children();
  bool wait_until_ready();
  void watch();
  bool continues_without(Role role);
  bool can_spare(Role role) const;
  void beat();
  void look_for_silence();
  void note_silence(Role role, double silent_s);
  void publish_event(Reason reason, const std::string& text);
  void stop_in_order();
  void note_status(const status_t& status);
  void note_dead_child();
  void request(RequestKind kind);
  std::string root_cause() const;
  bool end_early(const std::string& why);
  std::vector<std::string> arguments(Role role) const;

  DriveConfig drive_;
  SuperviseOptions options_;
  std::int64_t session_;
  ProcessSet set_;
  std::unique_ptr<Bus> bus_;
  Progress progress_;
  std::map<int, status_t> latest_;  // by role
  std::int64_t requests_ = 0;
  Truth truth_;
  Estimate estimate_;
  RunFacts facts_;
  bool frozen_ = false;     // the run ended because a process beat no more
  bool all_ready_ = false;  // the drive files were compared
  std::set<Role> ended_;    // whose end was reported while the drive goes on
  // Realtime: the last heartbeat of each process, and whose silence was reported.
  std::map<int, std::chrono::steady_clock::time_point> heard_;
  std::set<Role> silent_;
  std::chrono::steady_clock::time_point last_beat_{}, last_turn_{};
  std::map<int, event_t> failures_;  // first failure of each process, by role
};

}  // namespace twinrate

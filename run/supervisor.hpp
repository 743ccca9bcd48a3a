// Runs one process set from start to end and gathers what it said.
#pragma once
#include <map>
#include <string>

#include "core/bus.hpp"
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
};

class Supervisor {
 public:
  Supervisor(const DriveConfig& drive, SuperviseOptions options);
  // Starts the set, waits until every process is ready, starts the plant, watches until its end,
  // stops the rest.
  RunFacts run();

 private:
  void start_children();
  bool wait_until_ready();
  void watch();
  bool survives_without_the_gain();
  bool survives_without_the_monitor();
  void tell_the_log(Reason reason, const std::string& text);
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
  bool gain_death_told_ = false, monitor_death_told_ = false;
  std::map<int, event_t> failures_;  // by role: the first failure of each process
};

}  // namespace twinrate

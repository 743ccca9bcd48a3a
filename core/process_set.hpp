// Starts, watches and stops the processes of a drive.
//
// Every child dies with its parent (PR_SET_PDEATHSIG) and has its own process group, so Ctrl-C
// reaches the supervisor alone, which then stops the set in order: plant first, logger last.
#pragma once
#include <sys/types.h>

#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct Child {
  Role role;
  std::string program;
  pid_t pid = -1;
  bool ended = false;
  int exit_code = -1;  // 128 + signal if a signal ended it
  std::vector<std::string> arguments = {};
};

class ProcessSet {
 public:
  ~ProcessSet();  // kills the remaining processes
  ProcessSet() = default;
  ProcessSet(const ProcessSet&) = delete;
  ProcessSet& operator=(const ProcessSet&) = delete;

  // Searches a program beside this one; a name with a slash is the path of a file. Throws
  // MachineError if it cannot be started.
  void start(Role role, const std::string& program, const std::vector<std::string>& arguments);
  // Starts a child that has ended again, with these arguments besides its own. Throws as start().
  void restart(Role role, const std::vector<std::string>& more);
  // Notes children that have ended; true while all run.
  bool all_running();
  const std::vector<Child>& children() const { return children_; }
  const Child* child(Role role) const;
  // SIGTERM, then SIGKILL after `patience_s`; returns once they are gone.
  void stop(const std::vector<Role>& roles, double patience_s);

 private:
  void reap();
  std::vector<Child> children_;
};

// "exit code 1", "signal 9 (Killed)".
std::string describe_end(const Child& child);

}  // namespace twinrate

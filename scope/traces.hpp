// Traces of the displayed ticks, one at a time. Each is a separate process `twinrate trace` with
// lowered priority, and has its own directory: trace-1, trace-2, ..
#pragma once
#include <sys/types.h>

#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace twinrate::scope {

class Traces {
 public:
  // `program`: twinrate; `directory`: parent of the directories of the traces. "": no traces.
  Traces(std::string program, std::string directory);
  ~Traces();  // ends a running trace
  Traces(const Traces&) = delete;
  Traces& operator=(const Traces&) = delete;

  struct State {
    std::string directory, what;  // "dilys2021, 1.2 to 3.4 s"
    bool running = false;
    int exit_code = -1;  // 128 + signal if a signal ended it
    bool has_page() const { return !running && (exit_code == 0 || exit_code == 2); }
  };
  // Traces a drive log CSV with a drive file. Throws BadInput if a trace is running, or if the
  // directory cannot be written.
  int start(const std::string& drive_toml, const std::string& csv, const std::string& what);
  std::optional<State> state(int id);
  // The page of the trace, or a page with its progress that reloads itself. Throws BadInput if
  // there is no such trace.
  std::string page(int id);

 private:
  void reap();

  const std::string program_, directory_;
  std::mutex mutex_;
  std::map<int, State> traces_;
  pid_t running_ = -1;
  int running_id_ = 0;
};

}  // namespace twinrate::scope

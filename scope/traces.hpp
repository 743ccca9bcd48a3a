// Traces of what the page shows: each is a process `twinrate trace` of its own with lowered priority,
// and a directory of its own, trace-1, trace-2, .. One at a time.
#pragma once
#include <sys/types.h>

#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace twinrate::scope {

class Traces {
 public:
  // `program`: twinrate; `directory`: gets the directories of the traces. "": there are none.
  Traces(std::string program, std::string directory);
  ~Traces();  // ends the one that runs
  Traces(const Traces&) = delete;
  Traces& operator=(const Traces&) = delete;

  struct State {
    std::string directory, what;  // "dilys2021, 1.2 to 3.4 s"
    bool running = false;
    int exit_code = -1;  // 128 + signal where a signal ended it
    bool has_page() const { return !running && (exit_code == 0 || exit_code == 2); }
  };
  // Of a drive log CSV under a drive file. Throws BadInput while another one runs, and where the
  // directory cannot be written.
  int start(const std::string& drive_toml, const std::string& csv, const std::string& what);
  std::optional<State> state(int id);
  // The page of the trace, or one that says how far it is and comes again. Throws BadInput where
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

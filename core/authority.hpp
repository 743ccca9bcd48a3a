// The authority over a running set: its session, found through its run directory.
//
// The supervisor writes RUN_DIR/session.json when it starts a set and removes it at the end. Who
// can read it can bind to the session and steer the drive.
#pragma once
#include <cstdint>
#include <string>

namespace twinrate {

struct RunningSet {
  std::string directory, url, channel_suffix;  // url: empty: the default
  std::int64_t session = 0;
};

// The set that runs in `run_dir`; empty: the one below runs/ that was started last. Throws BadInput
// if there is none: nothing was found, or its supervisor has ended.
RunningSet find_running_set(const std::string& run_dir);

// The file, as long as this object lives.
class SessionFile {
 public:
  // Throws BadInput if the file exists or cannot be written.
  explicit SessionFile(const RunningSet& set);
  ~SessionFile();
  SessionFile(const SessionFile&) = delete;
  SessionFile& operator=(const SessionFile&) = delete;

 private:
  std::string path_;
};

}  // namespace twinrate

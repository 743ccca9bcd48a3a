// The recordings that the page can read: the drive of this scope, and runs as ghosts beside it.
//
// A run is named by its directory below one of the allowed directories. Only names of the list are
// accepted: the page cannot name a path.
#pragma once
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "scope/recording.hpp"

namespace twinrate::scope {

class Sources {
 public:
  // `runs_directory`: directory of the run directories that can be ghosts; "" or missing: no
  // ghosts. `memory_bytes`: limit of one ghost.
  Sources(std::shared_ptr<Recording> drive, std::string runs_directory, std::size_t memory_bytes);

  // Run directories that contain a log, newest first, at most kMostRuns.
  std::vector<std::string> runs() const;
  // "": the drive of this scope; "run:NAME": a run, which is loaded at the first call. nullptr: no
  // such run. Throws BadInput if its log cannot be read.
  std::shared_ptr<Recording> find(const std::string& source);
  Recording& drive() { return *drive_; }

 private:
  static constexpr std::size_t kMostRuns = 50, kLoadedRuns = 3;
  std::shared_ptr<Recording> drive_;
  std::string directory_;
  std::size_t memory_bytes_;
  std::mutex mutex_;
  std::vector<std::pair<std::string, std::shared_ptr<Recording>>> loaded_;
};

}  // namespace twinrate::scope

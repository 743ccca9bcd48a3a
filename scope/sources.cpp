#include "scope/sources.hpp"

#include <algorithm>
#include <filesystem>

#include "scope/recorded_drive.hpp"

namespace twinrate::scope {

namespace fs = std::filesystem;

Sources::Sources(std::shared_ptr<Recording> drive, std::string runs_directory,
                 std::size_t memory_bytes)
    : drive_(std::move(drive)),
      directory_(std::move(runs_directory)),
      memory_bytes_(memory_bytes) {}

std::vector<std::string> Sources::runs() const {
  std::vector<std::pair<fs::file_time_type, std::string>> found;
  std::error_code error;
  for (fs::directory_iterator at(directory_, error), end; !error && at != end;
       at.increment(error)) {
    std::error_code none;
    const fs::path log = at->path() / "log.lcm";
    const auto time = fs::last_write_time(log, none);
    if (!none) found.emplace_back(time, at->path().filename().string());
  }
  std::sort(found.rbegin(), found.rend());
  std::vector<std::string> names;
  for (const auto& [time, name] : found)
    if (names.size() < kMostRuns) names.push_back(name);
  return names;
}

std::shared_ptr<Recording> Sources::find(const std::string& source) {
  if (source.empty()) return drive_;
  if (!source.starts_with("run:")) return nullptr;
  const std::string name = source.substr(4);
  const std::lock_guard lock(mutex_);
  for (const auto& [known, recording] : loaded_)
    if (known == name) return recording;
  const std::vector<std::string> list = runs();
  if (std::find(list.begin(), list.end(), name) == list.end()) return nullptr;
  auto recording = std::make_shared<Recording>(1e9, memory_bytes_);
  load_log((fs::path(directory_) / name).string(), *recording);
  loaded_.emplace_back(name, recording);
  if (loaded_.size() > kLoadedRuns) loaded_.erase(loaded_.begin());
  return recording;
}

}  // namespace twinrate::scope

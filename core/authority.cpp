#include "core/authority.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/config.hpp"
#include "core/output_file.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
constexpr const char* kFile = "session.json";

// Empty where nothing runs there.
std::optional<RunningSet> running_in(const fs::path& directory) {
  std::ifstream in(directory / kFile);
  const auto json = in ? nlohmann::json::parse(in, nullptr, false) : nlohmann::json();
  if (!json.is_object() || !json.contains("pid") || !json.contains("session")) return {};
  if (kill(json["pid"].get<pid_t>(), 0) != 0 && errno == ESRCH) return {};
  return RunningSet{directory.string(), json.value("url", ""), json.value("channel_suffix", ""),
                    json["session"].get<std::int64_t>()};
}

}  // namespace

RunningSet find_running_set(const std::string& run_dir) {
  if (!run_dir.empty()) {
    if (const auto set = running_in(run_dir)) return *set;
    throw BadInput(fmt::format("{}: no drive runs in this directory", run_dir));
  }
  std::optional<RunningSet> newest;
  fs::file_time_type begun;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("runs", error)) {
    const auto set = running_in(entry.path());
    if (!set) continue;
    const fs::file_time_type time = fs::last_write_time(entry.path() / kFile, error);
    if (newest && time <= begun) continue;
    newest = set;
    begun = time;
  }
  if (!newest)
    throw BadInput("no drive runs in a directory of ./runs; give its directory: --run-dir DIR");
  return *newest;
}

SessionFile::SessionFile(const RunningSet& set)
    : path_((fs::path(set.directory) / kFile).string()) {
  const nlohmann::ordered_json json = {{"pid", getpid()},
                                       {"session", set.session},
                                       {"url", set.url},
                                       {"channel_suffix", set.channel_suffix}};
  write_new(path_, json.dump(2) + "\n");
  chmod(path_.c_str(), S_IRUSR | S_IWUSR);
}

SessionFile::~SessionFile() {
  std::error_code ignored;
  fs::remove(path_, ignored);
}

}  // namespace twinrate

#include "core/authority.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/config.hpp"
#include "core/output_file.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
constexpr const char* kFile = "session.json";

// Empty if no set runs there, or if the file belongs to another program.
std::optional<RunningSet> running_in(const fs::path& directory) {
  std::ifstream in(directory / kFile);
  if (!in) return {};
  try {
    const auto json = nlohmann::json::parse(in);
    if (!json.at("pid").is_number_integer() || !json.at("session").is_number_integer()) return {};
    const auto pid = json.at("pid").get<std::int64_t>();
    if (pid < 1 || pid > std::numeric_limits<pid_t>::max()) return {};  // kill() would mean others
    if (kill(static_cast<pid_t>(pid), 0) != 0 && errno == ESRCH) return {};
    return RunningSet{directory.string(), json.value("url", ""), json.value("channel_suffix", ""),
                      json.at("session").get<std::int64_t>()};
  } catch (const nlohmann::json::exception&) {
    return {};
  }
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
  // Written under another name: who finds the file finds the whole set.
  expect_free(path_, false);
  PartFile part(path_);
  std::ofstream file(part.part_path(), std::ios::binary);
  file << json.dump(2) << "\n";
  file.close();
  if (!file || chmod(part.part_path().c_str(), S_IRUSR | S_IWUSR) != 0) part.fail();
  part.finish();
}

SessionFile::~SessionFile() {
  std::error_code ignored;
  fs::remove(path_, ignored);
}

}  // namespace twinrate

#include "core/result_directory.hpp"

#include <fmt/format.h>
#include <regex.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/authority.hpp"
#include "core/config.hpp"
#include "core/output_file.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kRecord = ".twinrate.json";

struct KindInfo {
  const char* name;       // in the record
  const char* identity;   // the file that identifies the result
  const char* own_names;  // every file that a result of this kind can consist of: a POSIX pattern
  std::vector<const char*> needed;  // files of every finished result
};
const KindInfo kKinds[] = {
    {"run",
     "config.toml",
     R"(^(config\.toml|log\.lcm|log-[0-9]{3,}\.lcm|logger\.json|token|link\.json|monitor\.json|session\.json|summary\.json|)"
     R"(manifest\.json|learnt\.toml|report\.html)$)",
     {"summary.json", "manifest.json", "report.html"}},
    {"trace",
     "trace.json",
     R"(^(trace\.json|extended\.toml|report\.html|verify\.json)$)",
     {"trace.json", "report.html"}},
    {"plan", "plan.json", R"(^(plan\.json|plan\.toml|plan\.svg)$)", {"plan.json"}},
    {"sweep",
     "sweep.json",
     R"(^(sweep\.json|points\.csv|fbmin\.csv|figure\.svg|why\.csv)$)",
     {"points.csv"}},
    {"identify",
     "identify.json",
     R"(^(identified\.toml|identify\.json|identify\.txt)$)",
     {"identify.json"}},
};

const KindInfo& info_of(ResultKind kind) {
  return kKinds[static_cast<int>(kind)];
}

// The names in the directory that a result of this kind could use.
std::vector<std::string> own_names_in(const std::string& directory, ResultKind kind) {
  regex_t own;  // std::regex is slow to compile
  const int compiled = regcomp(&own, info_of(kind).own_names, REG_EXTENDED | REG_NOSUB);
  assert(compiled == 0);
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(directory, error))
    if (const std::string name = entry.path().filename().string();
        regexec(&own, name.c_str(), 0, nullptr, 0) == 0)
      names.push_back(name);
  regfree(&own);
  std::sort(names.begin(), names.end());
  return names;
}

std::string record_path(const std::string& directory) {
  return directory + "/" + kRecord;
}

bool is_record(const Json& record) {
  if (!record.is_object() || !record.contains("program") || record["program"] != "twinrate")
    return false;
  return std::all_of(std::begin(kKinds), std::end(kKinds), [&](const KindInfo& kind) {
    const auto entry = record.find(kind.name);
    return entry == record.end() ||
           (entry->is_object() && entry->contains("finished") && (*entry)["finished"].is_boolean());
  });
}

// An empty object if the directory holds no record. Throws BadInput if the file is another one.
Json read_record(const std::string& directory) {
  const std::string path = record_path(directory);
  if (!name_is_taken(path)) return Json::object();
  std::ifstream file(path);
  Json record = Json::parse(file, nullptr, false);
  if (!is_record(record))
    throw BadInput(fmt::format("{}: is not a record of twinrate; give another directory", path));
  return record;
}

// Throws std::runtime_error if the disk is full.
void write_record(const std::string& directory, Json record) {
  record["program"] = "twinrate";
  PartFile part(record_path(directory));
  std::ofstream file(part.part_path());
  file << record.dump(1) << '\n';
  file.close();
  if (!file) part.fail();
  part.finish();
}

// Existing files of the recorded result of this kind.
std::vector<std::string> recorded_files(const Json& record, ResultKind kind,
                                        const std::vector<std::string>& there) {
  const auto entry = record.find(info_of(kind).name);
  if (entry == record.end() || !entry->is_object()) return {};
  if (!entry->value("finished", false)) return there;
  std::vector<std::string> files;
  const Json listed = entry->value("files", Json::array());
  for (const std::string& name : there)
    if (std::find(listed.begin(), listed.end(), name) != listed.end()) files.push_back(name);
  return files;
}

// Why the directory is refused without --force; empty if the record names no result.
std::string refusal(const std::string& directory, const Json& record, ResultKind wanted) {
  for (const KindInfo& kind : kKinds) {
    if (!record.contains(kind.name) || !record[kind.name].is_object()) continue;
    const bool finished = record[kind.name].value("finished", false);
    return fmt::format("{}: holds {} {}; give another directory, or --force to {}", directory,
                       finished ? "a finished" : "an unfinished", kind.name,
                       &kind == &info_of(wanted) ? "replace its files" : "write beside it");
  }
  return "";
}

// Of a launched set: its session file names a process that lives.
bool a_drive_runs_in(const std::string& directory) {
  try {
    find_running_set(directory);
    return true;
  } catch (const BadInput&) {
    return false;
  }
}

// True if a directory was created.
bool create_writable(const std::string& path) {
  std::error_code refused;
  const bool made = fs::create_directories(path, refused);
  if (!refused && access(path.c_str(), W_OK) != 0)
    refused = std::error_code(errno, std::generic_category());
  if (refused) throw BadInput(fmt::format("{}: cannot be written: {}", path, refused.message()));
  return made;
}

}  // namespace

ResultDirectory::ResultDirectory(std::string path, ResultKind kind, bool force, bool resume)
    : path_(std::move(path)), kind_(kind), resume_(resume) {
  if (fs::is_directory(path_)) expect_replaceable(force);
  made_ = create_writable(path_);
}

void ResultDirectory::expect_replaceable(bool force) {
  const KindInfo& kind = info_of(kind_);
  const Json record = read_record(path_);
  if (kind_ == ResultKind::kRun && a_drive_runs_in(path_))
    throw BadInput(fmt::format(
        "{}: a drive runs in this directory; stop it, or give another directory", path_));
  const std::vector<std::string> there = own_names_in(path_, kind_);
  // A caller that resumes compares the identity.
  const bool resumed = resume_ && name_is_taken(path_ + "/" + kind.identity);
  replaced_ = resumed ? there : recorded_files(record, kind_, there);
  for (const std::string& name : there)
    if (std::find(replaced_.begin(), replaced_.end(), name) == replaced_.end() ||
        !fs::is_regular_file(fs::symlink_status(fs::path(path_) / name)))
      throw BadInput(
          fmt::format("{}/{}: exists and was not made by a {} here; give another directory", path_,
                      name, kind.name));
  const std::string why = refusal(path_, record, kind_);
  if (!why.empty() && !force && !resumed) throw BadInput(why);
}

ResultDirectory::~ResultDirectory() {
  std::error_code not_empty;
  if (made_) fs::remove(path_, not_empty);
}

void ResultDirectory::begin() {
  Json record = read_record(path_);
  record[info_of(kind_).name] = {{"finished", false}};
  write_record(path_, record);
  if (resume_) return;
  for (const std::string& name : replaced_) {
    std::error_code error;
    fs::remove(fs::path(path_) / name, error);
    if (error)
      throw BadInput(fmt::format("{}/{}: cannot be replaced: {}", path_, name, error.message()));
  }
}

void ResultDirectory::finish() {
  for (const char* name : info_of(kind_).needed)
    if (!name_is_taken(path_ + "/" + name)) return;
  try {
    Json record = read_record(path_);
    record[info_of(kind_).name] = {{"finished", true}, {"files", own_names_in(path_, kind_)}};
    write_record(path_, record);
  } catch (const std::runtime_error&) {
  }
}

}  // namespace twinrate

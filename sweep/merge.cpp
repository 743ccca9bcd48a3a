#include "sweep/merge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "core/output_file.hpp"
#include "loop/load_drive.hpp"
#include "sweep/run.hpp"
#include "sweep/store.hpp"

namespace twinrate::sweep {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> shard_directories(const std::vector<std::string>& directories) {
  std::vector<std::string> found;
  for (const std::string& directory : directories) {
    const std::size_t before = found.size();
    if (!fs::is_directory(directory)) throw BadInput(directory + ": no such directory");
    for (const auto& entry : fs::directory_iterator(directory))
      if (entry.path().filename().string().starts_with("shard-"))
        found.push_back(entry.path().string());
    if (found.size() == before) found.push_back(directory);
    std::sort(found.begin() + static_cast<std::ptrdiff_t>(before), found.end());
  }
  return found;
}

std::string identity_in(const std::string& directory) {
  std::ifstream file(directory + "/sweep.json");
  if (!file) throw BadInput(directory + ": no sweep.json: not the directory of a sweep");
  return {std::istreambuf_iterator<char>(file), {}};
}

void refuse_missing(const Plan& plan, const std::vector<Point>& points) {
  for (const Search& search : searches(plan))
    if (const auto n = next_to_try(of_search(points, search), search, plan.n_max))
      throw BadInput(fmt::format("a point is missing: policy {}, {} Hz, n = {}, seed {}",
                                 search.policy, search.f_e_Hz, *n, search.seed));
}

}  // namespace

void merge(const std::vector<std::string>& directories, const std::string& out, bool json,
           bool force) {
  const std::vector<std::string> shards = shard_directories(directories);
  const std::string identity = identity_in(shards.front());
  std::vector<Point> points;
  for (const std::string& shard : shards) {
    if (identity_in(shard) != identity)
      throw BadInput(
          fmt::format("{} and {} are of different sweeps (drive, keys, speeds, policies "
                      "or seeds)",
                      shards.front(), shard));
    const std::vector<Point> some = read_points(shard + "/points.csv");
    points.insert(points.end(), some.begin(), some.end());
  }
  const Plan plan = plan_of(identity);
  sort_points(plan, points);
  refuse_missing(plan, points);
  const std::string directory = out.empty() ? directories.front() : out;
  const Config config = load_drive(plan.drive, plan.overrides);
  ResultDirectory result(directory, ResultKind::kSweep, force);
  result.begin();
  write_new(directory + "/sweep.json", identity);
  write_result(plan, config, directory, points, json);
  result.finish();
}

}  // namespace twinrate::sweep

#include "sweep/run.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <exception>
#include <filesystem>
#include <thread>

#include "core/output_file.hpp"
#include "core/process.hpp"
#include "sweep/store.hpp"

namespace twinrate::sweep {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kPointsAtOnce = 8;  // points of one search in one row of lanes

std::string read_whole(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Assigns the directory to one sweep. Throws BadInput if it belongs to another one.
void claim(ResultDirectory& directory, const std::string& identity, bool resume) {
  const std::string path = directory.path() + "/sweep.json";
  const bool resumed = resume && std::filesystem::exists(path);
  if (resumed && read_whole(path) != identity)
    throw BadInput(path + ": --resume: another sweep (drive, keys, speeds, policies or seeds)");
  directory.begin();
  if (!resumed) write_new(path, identity);
}

// The progress line and the lines of --json.
class Live {
 public:
  Live(bool json, std::size_t searches) : json_(json), searches_(searches) {}
  void show(const Point& point, std::size_t done, bool last_of_search) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++points_;
    const auto now = Clock::now();
    if (json_) {
      fmt::print(
          "{{\"policy\": \"{}\", \"f_e_Hz\": {}, \"n\": {}, \"seed\": {}, \"locked\": {}, "
          "\"searches_done\": {}, \"searches\": {}}}\n",
          point.search.policy, point.search.f_e_Hz, point.n, point.search.seed, point.locked, done,
          searches_);
      std::fflush(stdout);
    } else if (terminal_ && (last_of_search || now - last_ > std::chrono::milliseconds(200))) {
      fmt::print("\r{} of {} searches, {} points; {} at {:g} Hz: n = {} {}   ", done, searches_,
                 points_, point.search.policy, point.search.f_e_Hz, point.n,
                 point.locked ? "held" : "lost");
      std::fflush(stdout);
      last_ = now;
    }
  }
  void end() {
    if (terminal_ && !json_ && points_ > 0) fmt::print("\n");
  }

 private:
  bool json_, terminal_ = isatty(STDOUT_FILENO) != 0;
  std::size_t searches_, points_ = 0;
  Clock::time_point last_{};
  std::mutex mutex_;
};

class Engine {
 public:
  Engine(const Plan& plan, const DriveConfig& base, PointFile& file, std::string directory,
         const RunOptions& options)
      : plan_(plan), base_(base), file_(file), directory_(std::move(directory)), options_(options) {
    const auto all = searches(plan);
    const bool lanes = plan.engine == "lanes" && plan.over == "inprocess" && plan.log.empty();
    std::size_t count = 0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (static_cast<int>(i % static_cast<std::size_t>(plan.shards)) != plan.shard) continue;
      const bool joins = lanes && !groups_.empty() && same_but_for_seed(groups_.back()[0], all[i]);
      if (!joins) groups_.emplace_back();
      groups_.back().push_back(all[i]);
      ++count;
    }
    if (!plan.log.empty()) log_ = read_run_log(plan.log);
    live_.emplace(options.json, count);
  }

  // Over LCM, one process set at a time: a set needs all cores.
  void run() {
    const unsigned cores = std::max(1U, std::thread::hardware_concurrency());
    const unsigned wanted = plan_.over == "lcm" ? 1 : cores;
    lane_threads_ = std::max(1, static_cast<int>(cores / std::max<std::size_t>(1, groups_.size())));
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < wanted; ++i) threads.emplace_back([this] { work(); });
    for (std::thread& thread : threads) thread.join();
    live_->end();
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void work() {
    try {
      for (std::size_t i = next_++; i < groups_.size() && !stop(); i = next_++) search(groups_[i]);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex_);
      if (!failure_) failure_ = std::current_exception();
    }
  }
  bool stop() {
    const std::lock_guard<std::mutex> lock(failure_mutex_);
    return stop_signalled() || failure_;
  }
  static bool same_but_for_seed(const Search& a, const Search& b) {
    return a.policy == b.policy && a.f_e_Hz == b.f_e_Hz;
  }
  // The next points of each search of the group together, until all of them are complete.
  void search(const std::vector<Search>& group) {
    std::vector<std::vector<Point>> points(group.size());
    for (std::size_t i = 0; i < group.size(); ++i)
      for (const Point* p : of_search(file_.found(), group[i])) points[i].push_back(*p);
    const auto next = [&](std::size_t i) {
      return next_to_try(of_search(points[i], group[i]), group[i], plan_.n_max);
    };
    std::optional<LaneDrive> in_lanes;
    if (plan_.engine == "lanes" && plan_.over == "inprocess" && plan_.log.empty())
      in_lanes = lane_drive(plan_, base_, group.front());
    while (!stop()) {
      std::vector<Task> tasks;
      std::vector<std::size_t> of_task;  // index of its search
      for (std::size_t i = 0; i < group.size(); ++i) {
        const auto n = next(i);
        const std::size_t end = tasks.size() + (in_lanes ? kPointsAtOnce : 1);
        for (int k = n.value_or(plan_.n_max + 1); k <= plan_.n_max && tasks.size() < end;
             k = next_n(k)) {
          tasks.push_back({group[i], k});
          of_task.push_back(i);
        }
      }
      if (tasks.empty()) break;
      const std::vector<Point> run =
          in_lanes ? run_in_lanes(plan_, *in_lanes, tasks, lane_threads_) : run_one_by_one(tasks);
      if (stop_signalled()) return;  // the signal also interrupted launch
      for (std::size_t t = 0; t < run.size(); ++t) {
        const std::size_t i = of_task[t];
        if (next(i) != run[t].n) continue;  // beyond the loss that ended the search
        file_.append(run[t]);
        points[i].push_back(run[t]);
        const bool last = !next(i);
        live_->show(run[t], done_ += last ? 1 : 0, last);
      }
    }
  }
  std::vector<Point> run_one_by_one(const std::vector<Task>& tasks) const {
    std::vector<Point> points;
    for (const auto& [search, n] : tasks) {
      if (stop_signalled()) break;
      points.push_back(run_point(search, n));
    }
    return points;
  }
  Point run_point(const Search& search, int n) const {
    if (!plan_.log.empty()) return run_on_log(log_, plan_, search, n);
    if (plan_.over == "lcm") return run_over_lcm(plan_, base_, search, n, directory_);
    return run_in_process(plan_, base_, search, n);
  }

  const Plan& plan_;
  const DriveConfig& base_;
  PointFile& file_;
  std::string directory_;
  const RunOptions& options_;
  std::vector<std::vector<Search>>
      groups_;  // run together: the seeds of a policy and speed in lanes
  int lane_threads_ = 1;
  RunLog log_;
  std::optional<Live> live_;
  std::atomic<std::size_t> next_ = 0, done_ = 0;
  std::mutex failure_mutex_;
  std::exception_ptr failure_;
};

}  // namespace

bool run_searches(const Plan& plan, const Config& config, ResultDirectory& directory,
                  const RunOptions& options) {
  claim(directory, identity(plan, config), options.resume);
  PointFile file(directory.path() + "/points.csv", options.resume);
  Engine(plan, config.drive(), file, directory.path(), options).run();
  return stop_signalled();
}

}  // namespace twinrate::sweep

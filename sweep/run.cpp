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
    for (std::size_t i = 0; i < all.size(); ++i)
      if (static_cast<int>(i % static_cast<std::size_t>(plan.shards)) == plan.shard)
        searches_.push_back(all[i]);
    if (!plan.log.empty()) log_ = read_run_log(plan.log);
    live_.emplace(options.json, searches_.size());
  }

  // Over LCM, one process set at a time: a set needs all cores.
  void run() {
    const unsigned wanted = plan_.over == "lcm" ? 1 : std::thread::hardware_concurrency();
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < std::max(1U, wanted); ++i) threads.emplace_back([this] { work(); });
    for (std::thread& thread : threads) thread.join();
    live_->end();
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void work() {
    try {
      for (std::size_t i = next_++; i < searches_.size() && !stop(); i = next_++)
        search(searches_[i]);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex_);
      if (!failure_) failure_ = std::current_exception();
    }
  }
  bool stop() {
    const std::lock_guard<std::mutex> lock(failure_mutex_);
    return stop_signalled() || failure_;
  }
  void search(const Search& search) {
    std::vector<Point> points;
    for (const Point* p : of_search(file_.found(), search)) points.push_back(*p);
    std::deque<Point> ahead;
    while (!stop()) {
      const auto n = next_to_try(of_search(points, search), search, plan_.n_max);
      if (!n) break;
      const Point point = run_point(search, *n, ahead);
      if (stop_signalled()) return;  // the signal also interrupted launch
      file_.append(point);
      points.push_back(point);
      const bool last = !next_to_try(of_search(points, search), search, plan_.n_max);
      live_->show(point, done_ += last ? 1 : 0, last);
    }
  }
  // `ahead`: points of this search that the lane engine has already run.
  Point run_point(const Search& search, int n, std::deque<Point>& ahead) const {
    if (plan_.engine == "lanes" && plan_.over == "inprocess" && plan_.log.empty()) {
      if (ahead.empty() || ahead.front().n != n) {
        std::vector<int> row;
        for (int n_i = n; n_i <= plan_.n_max && row.size() < kPointsAtOnce; n_i = next_n(n_i))
          row.push_back(n_i);
        const auto points = run_in_lanes(plan_, base_, search, row);
        ahead.assign(points.begin(), points.end());
      }
      if (!ahead.empty()) {
        const Point point = ahead.front();
        ahead.pop_front();
        return point;
      }
    }
    return run_point(search, n);
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
  std::vector<Search> searches_;
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

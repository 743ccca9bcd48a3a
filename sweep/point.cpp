#include "sweep/point.hpp"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "analysis/summary.hpp"
#include "core/machine_error.hpp"
#include "estimator/make_filter.hpp"
#include "lanes/engine.hpp"
#include "loop/closed_loop.hpp"
#include "loop/estimator_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::sweep {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

void set_verdict(const RunLog& log, const DriveConfig& drive, Point& point) {
  const Summary summary = summarise(log, drive);
  point.locked = summary.locked.value_or(false);
  point.angle_error_rms = summary.angle_error_rms.value_or(kNaN);
  point.angle_error_max = summary.angle_error_max.value_or(kNaN);
}

// A drive that switched off has lost synchronism, whatever its later estimate is.
void note_trip(const TickRecord& tick, RunLog& log) {
  const auto note = [&](Reason reason, const std::string& text, Role role) {
    if (is_trip(reason))
      log.events.push_back({.k = tick.measurement.k,
                            .t_ns = tick.measurement.t_ns,
                            .role = static_cast<int>(role),
                            .reason = static_cast<int>(reason),
                            .text = text});
  };
  note(tick.event.reason, tick.event.text, Role::kController);
  for (const PlantEvent& event : tick.plant_events) note(event.reason, event.text, Role::kPlant);
}

// Start and window of the recording, as keys: the filter of another drive file begins as the recorded
// one did.
std::vector<std::string> of_recording(const RunLog& log, const DriveConfig& asked) {
  if (log.config_toml.empty()) return {};
  Config config = Config::parse(log.config_toml, log.path + " (DRIVE_MANIFEST)");
  read_all_tables(config);
  const DriveConfig& d = config.drive();
  std::vector<std::string> list = {
      fmt::format("run.settle_s={}", d.run.settle_s),
      fmt::format("run.duration_s={}", d.run.duration_s),
      fmt::format("start={}", kStartNames[static_cast<int>(d.start)]),
      fmt::format("plant.theta_e_start_rad={}", d.plant.theta_e_start)};
  if (d.start == Start::kFlying)
    list.push_back(
        asked.reference.in_rpm
            ? fmt::format("reference.speed_rpm={}", d.omega_m_start() * 60 / kTwoPi)
            : fmt::format("reference.omega_e_rad_s={}", asked.machine.n_p * d.omega_m_start()));
  return list;
}

Config config_on(const RunLog& log, const Plan& plan, const std::vector<std::string>& more) {
  const DriveConfig asked = load_drive(plan.drive, plan.overrides).drive();
  std::vector<std::string> list = of_recording(log, asked);
  list.insert(list.end(), plan.overrides.begin(), plan.overrides.end());
  list.insert(list.end(), more.begin(), more.end());
  return load_drive(plan.drive, list);
}

// Half a tick before the last snapshot that is at least 0.3 s before the window.
double switch_before(double settle_s, int n, double T_s) {
  return std::max(0.0, (std::floor((settle_s - 0.3) / T_s / n) * n - 0.5) * T_s);
}

// A new directory within `directory`; removed with its content.
class Scratch {
 public:
  explicit Scratch(const std::string& directory) : path_(directory + "/run-XXXXXX") {
    if (!mkdtemp(path_.data())) throw BadInput(directory + ": cannot be written");
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

int run_quietly(const std::vector<std::string>& arguments) {
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& text : arguments) argv.push_back(const_cast<char*>(text.c_str()));
  argv.push_back(nullptr);
  const pid_t pid = fork();
  if (pid < 0) throw MachineError("cannot start twinrate launch: fork failed");
  if (pid == 0) {
    if (!std::freopen("/dev/null", "w", stdout)) _exit(127);
    execv("/proc/self/exe", argv.data());
    _exit(127);
  }
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

}  // namespace

Point run_in_process(const Plan& plan, const DriveConfig& base, const Search& search, int n) {
  Config config = load_drive(plan.drive, point_overrides(plan, base, search, n));
  const DriveConfig& drive = config.drive();
  Point point{.search = search, .f_s_Hz = drive.rates.f_s_Hz, .n = n};
  ClosedLoop loop(config);
  RunLog log;
  const auto steps = static_cast<std::size_t>(drive.steps());
  log.measurement.reserve(steps);
  log.truth.reserve(steps);
  log.estimate.reserve(steps);
  log.command.reserve(steps);
  while (loop.k() < drive.steps()) {
    const TickRecord& tick = loop.step();
    log.measurement.push_back(tick.measurement);
    log.truth.push_back(tick.truth);
    log.estimate.push_back(tick.estimate);
    log.command.push_back(tick.command);
    note_trip(tick, log);
  }
  set_verdict(log, drive, point);
  return point;
}

std::optional<LaneDrive> lane_drive(const Plan& plan, const DriveConfig& base,
                                    const Search& search) {
  Config config = load_drive(plan.drive, point_overrides(plan, base, search, 1));
  LaneDrive found{.drive = config.drive()};
  if (!lanes::lane_settings(config, found.settings).empty()) return {};
  return found;
}

std::vector<Point> run_in_lanes(const Plan& plan, const LaneDrive& lane_drive,
                                std::span<const Task> tasks, int threads) {
  std::vector<lanes::Point> asked;
  DriveConfig drive = lane_drive.drive;
  for (const auto& [search, n] : tasks) {
    const PointTimes times = point_times(plan, drive, search.f_e_Hz, n);
    drive.rates.n = n;
    drive.rates.n_from_s = times.n_from_s;
    drive.run = {.duration_s = times.duration_s, .settle_s = times.settle_s, .seed = search.seed};
    asked.push_back(lanes::point_of(drive));
  }
  std::vector<lanes::PointResult> results(asked.size());
  lanes::run_points(lane_drive.settings, asked, results, threads);
  std::vector<Point> points;
  for (std::size_t i = 0; i < tasks.size(); ++i)
    points.push_back({.search = tasks[i].search,
                      .f_s_Hz = drive.rates.f_s_Hz,
                      .n = tasks[i].n,
                      .locked = results[i].locked,
                      .angle_error_rms = results[i].angle_error_rms_rad,
                      .angle_error_max = results[i].angle_error_max_rad});
  return points;
}

Point run_over_lcm(const Plan& plan, const DriveConfig& base, const Search& search, int n,
                   const std::string& directory) {
  const Scratch scratch(directory);
  std::vector<std::string> arguments = {"twinrate", "launch", plan.drive, "--run-dir",
                                        scratch.path()};
  for (const std::string& text : point_overrides(plan, base, search, n))
    arguments.insert(arguments.end(), {"--set", text});
  const int code = run_quietly(arguments);
  std::ifstream file(scratch.path() + "/summary.json");
  if (code > 1 || !file)
    throw MachineError(fmt::format(
        "twinrate launch ended with exit code {} (multicast? try twinrate doctor)", code));
  const auto summary = nlohmann::json::parse(file);
  const auto number = [&](const char* key) {
    return summary[key].is_number() ? summary[key].get<double>() : kNaN;
  };
  Point point{.search = search, .f_s_Hz = base.rates.f_s_Hz, .n = n};
  point.locked = summary["locked"].is_boolean() && summary["locked"].get<bool>();
  point.angle_error_rms = number("angle_error_rms_rad");
  point.angle_error_max = number("angle_error_max_rad");
  return point;
}

Point run_on_log(const RunLog& recorded, const Plan& plan, const Search& search, int n) {
  std::vector<std::string> list = {"gain.policy=" + search.policy};
  list.emplace_back("rates.f_b_Hz=0");  // before n: the later of both keys is used
  list.push_back(fmt::format("rates.n={}", n));
  list.emplace_back("rates.n_from=start");
  if (plan.start == "switched") {
    const DriveConfig asked = config_on(recorded, plan, {}).drive();
    list.push_back(
        fmt::format("rates.n_from_s={}", switch_before(asked.run.settle_s, n, asked.T_s())));
  }
  Config config = config_on(recorded, plan, list);
  const DriveConfig& drive = config.drive();
  EstimatorLoop estimator(config);
  RunLog log;  // without COMMAND: the speed is not judged in open loop
  log.measurement = recorded.measurement;
  log.truth = recorded.truth;
  for (const Measurement& m : recorded.measurement) log.estimate.push_back(estimator.tick(m));
  Point point{.search = search, .f_s_Hz = drive.rates.f_s_Hz, .n = n};
  set_verdict(log, drive, point);
  return point;
}

void expect_speeds_reached(const Plan& plan, const DriveConfig& base) {
  constexpr double kNear = 0.1;
  for (const double f_e_Hz : plan.speeds_Hz) {
    const Search search{plan.policies.front(), f_e_Hz, 1};
    Config config = load_drive(plan.drive, point_overrides(plan, base, search, 1));
    const DriveConfig& d = config.drive();
    ClosedLoop loop(config);
    RunLog log;
    double sum = 0;
    int count = 0;
    while (loop.k() < d.steps()) {
      const TickRecord& tick = loop.step();
      log.measurement.push_back(tick.measurement);
      log.truth.push_back(tick.truth);
      log.estimate.push_back(tick.estimate);
      note_trip(tick, log);
      if (1e-9 * static_cast<double>(tick.measurement.t_ns) >= d.run.settle_s)
        sum += tick.truth.omega_m, ++count;
    }
    const Summary summary = summarise(log, d);
    if (summary.never_handed_over)
      throw BadInput(
          fmt::format("--speeds: {:g} Hz: no hand-over to the estimate before the end at {:.3g} s, "
                      "with a gain every tick; --start switched begins at speed",
                      f_e_Hz, d.run.duration_s));
    if (!summary.locked.value_or(false) || count == 0) continue;  // a loss at n = 1
    const double turned_Hz = d.machine.n_p * sum / count / kTwoPi;
    if (std::abs(turned_Hz / f_e_Hz - 1) > kNear)
      throw BadInput(fmt::format(
          "--speeds: {:g} Hz: the drive turns at {:.4g} Hz from {:.3g} to {:.3g} s, with a gain "
          "every tick: its voltage, its torque or --ramp-rad-s2 does not allow more",
          f_e_Hz, turned_Hz, d.run.settle_s, d.run.duration_s));
  }
}

double recorded_f_e_Hz(const RunLog& log, const Plan& plan) {
  const Config config = config_on(log, plan, {});
  if (log.measurement.size() > 1) {
    const Measurement &a = log.measurement.front(), &b = log.measurement.back();
    const double f_s = 1e9 * static_cast<double>(b.k - a.k) / static_cast<double>(b.t_ns - a.t_ns);
    if (std::abs(f_s / config.drive().rates.f_s_Hz - 1) > 1e-3)
      throw BadInput(fmt::format("{}: recorded at {:.6g} Hz, but {} has rates.f_s_Hz = {:.6g}",
                                 log.path, f_s, plan.drive, config.drive().rates.f_s_Hz));
  }
  const std::vector<TickError> ticks = tick_errors(log, config.drive());
  double sum = 0;
  int count = 0;
  for (const TickError& tick : ticks)
    if (std::isfinite(tick.omega_m) && tick.t_s >= config.drive().run.settle_s)
      sum += std::abs(tick.omega_m), ++count;
  if (count == 0) throw BadInput(log.path + ": no rotor angle to compare with");
  return config.drive().machine.n_p * sum / count / kTwoPi;
}

}  // namespace twinrate::sweep

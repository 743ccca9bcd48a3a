// Long runs: whether memory is flat, the state finite and nothing lost, as the table of
// docs/faults.md.
//
//   endurance [--hours 8]                      one drive in this process, without a log
//   endurance --set TWINRATE [--minutes 20]    `TWINRATE launch` in lock-step over LCM, until Ctrl-C
//   endurance --covariance 1e8 [--only TEXT]   every filter, gain policy, motion: so many updates of P
//
// In this process, a row for each hour of drive time: the resident memory, the largest angle error,
// and of P (symmetric part) the smallest eigenvalue and the largest difference P - P'. The set: the
// resident memory of each process after a minute, the most since then and at the end; the losses; and
// whether the messages of every tick are those of the loop in this process, bit for bit.
//
// --covariance: the snapshots of 0.1 s of a run over and over, at speed, at standstill and "still",
// with a state of zeros, a row for each filter and policy with a background. Of the correlation matrix
// C of P, every thousandth time, the largest difference C - C' and the least eigenvalue; and the
// largest share of its ceiling that a variance reached (estimator/covariance_ceiling.hpp). All
// filters are in double precision. The policies immediate and rotate have the covariance of paper,
// bit for bit (tests/loop/long_run_test.cpp); scheduled has none.
//
// Exit code 1 if the drive is not locked, P is not positive definite, a message is lost or differs,
// or a process has grown by more than 1 MB since its first minute.
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/child.hpp"
#include "bench/command_line.hpp"
#include "bench/log_digest.hpp"
#include "core/report_error.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/registry.hpp"
#include "loop/closed_loop.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kGrowth_MB = 1;

struct Options {
  std::string drive = "dilys2021", twinrate, dir = "/tmp", run_dir;
  double hours = 8, minutes = 20, covariance = 0;
  std::string only;
  std::vector<std::string> overrides;
};

double resident_MB(const fs::path& process) {
  std::ifstream file(process / "status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("VmRSS:")) return std::atof(line.c_str() + sizeof "VmRSS:") / 1024;
  return 0;
}

// -- in this process ------------------------------------------------------------------------------

struct Hour {
  double angle_error = 0, least_eigenvalue = HUGE_VAL, asymmetry = 0;
  bool finite = true;
  void take(const TickRecord& tick, int n_p) {
    const double error = wrap_pi(tick.estimate.theta_e - n_p * tick.truth.theta_m);
    angle_error = std::max(angle_error, std::abs(error));
    finite = finite && std::isfinite(error) && tick.estimate.x_hat.allFinite() &&
             tick.command.u_alphabeta_ref.allFinite();
  }
  void take(const Gain& gain) {
    const Eigen::MatrixXd P = gain.P.topLeftCorner(gain.n_x, gain.n_x);
    finite = finite && P.allFinite();
    asymmetry = std::max(asymmetry, (P - P.transpose()).cwiseAbs().maxCoeff());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(0.5 * (P + P.transpose()),
                                                                Eigen::EigenvaluesOnly);
    least_eigenvalue = std::min(least_eigenvalue, solver.eigenvalues().minCoeff());
  }
};

bool run_loop(const Options& o) {
  constexpr std::int64_t kGainsBetween = 1000;  // an eigenvalue costs as much as many ticks
  Config config = Config::load(o.drive, o.overrides);
  const DriveConfig drive = config.drive();
  ClosedLoop loop(config);
  const auto ticks = static_cast<std::int64_t>(std::llround(3600 * drive.rates.f_s_Hz));
  const auto settle = static_cast<std::int64_t>(std::llround(drive.rates.f_s_Hz));
  bool well = true;
  double first_MB = 0;
  std::int64_t gains = 0;
  fmt::print(
      "| drive time | ticks | memory | largest angle error | least eigenvalue of P | P - P' | "
      "finite |\n|---|---|---|---|---|---|---|\n");
  const std::clock_t begun = std::clock();
  for (int hour = 1; hour <= std::lround(o.hours); ++hour) {
    Hour seen;
    for (std::int64_t i = 0; i < ticks; ++i) {
      const TickRecord& tick = loop.step();
      if (loop.k() > settle) seen.take(tick, drive.machine.n_p);
      if (tick.has_gain && gains++ % kGainsBetween == 0) seen.take(tick.gain);
    }
    const double MB = resident_MB("/proc/self");
    if (hour == 1) first_MB = MB;
    fmt::print("| {} h | {} | {:.1f} MB | {:.3f} deg | {:.3g} | {:.2g} | {} |\n", hour, loop.k(),
               MB, seen.angle_error * 180 / kPi, seen.least_eigenvalue, seen.asymmetry,
               seen.finite ? "yes" : "NO");
    std::fflush(stdout);
    well = well && seen.finite && seen.angle_error < kPi / 2 && seen.least_eigenvalue > 0 &&
           MB - first_MB < kGrowth_MB;
  }
  fmt::print("\n{} h of drive time in {:.0f} s of CPU time\n", std::lround(o.hours),
             static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC);
  return well;
}

// -- covariances ----------------------------------------------------------------------------------

// A drive that the filter is made for.
std::string drive_of(const std::string& kind) {
  const bool salient = kind == "active_flux" || kind == "eemf" || kind == "dq_ekf";
  if (salient || kind == "backemf_printed") return "kim-ipmsm";
  return kind == "ekf_sensorless" || kind == "ekf_joint" ? "dilys2021" : "niewiara2020";
}

// The snapshots of the last 0.1 s of 0.3 s.
std::vector<Estimate> snapshots(Config& config) {
  ClosedLoop loop(config);
  std::vector<Estimate> all;
  for (double t = 0; t < 0.3; t = static_cast<double>(loop.k()) * config.drive().T_s()) {
    const TickRecord& tick = loop.step();
    if (tick.has_gain && t >= 0.2) all.push_back(tick.estimate);
  }
  return all;
}

struct Correlation {
  CovarianceCeiling ceiling;
  double asymmetry = 0, least_eigenvalue = HUGE_VAL, share = 0;
  bool well = true;
  void take(const Gain& gain) {
    const Eigen::MatrixXd P = gain.P.topLeftCorner(gain.n_x, gain.n_x);
    well = well && P.allFinite() && gain.K.allFinite() && P.diagonal().minCoeff() > 0;
    if (!well) return;
    share = std::max(share, P.diagonal().cwiseQuotient(ceiling.P_max()).maxCoeff());
    const Eigen::VectorXd scale = P.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd C = scale.asDiagonal() * P * scale.asDiagonal();
    asymmetry = std::max(asymmetry, (C - C.transpose()).cwiseAbs().maxCoeff());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(0.5 * (C + C.transpose()),
                                                                Eigen::EigenvaluesOnly);
    least_eigenvalue = std::min(least_eigenvalue, solver.eigenvalues().minCoeff());
    well = least_eigenvalue > 0 && asymmetry < 1e-6 && share <= 1;
  }
};

enum class Moves { kTurns, kStands, kStill };
constexpr const char* kMovesNames[] = {"speed", "standstill", "still"};

std::string row_name(const std::string& kind, const std::string& policy, Moves moves) {
  return fmt::format("{}, {}, {}", kind, policy, kMovesNames[static_cast<int>(moves)]);
}

bool run_covariance(const Options& o, const std::string& kind, const std::string& policy,
                    Moves moves) {
  std::vector<std::string> overrides = {"estimator.kind=" + kind,
                                        "gain.policy=" + policy,
                                        "load.T_load_Nm=0",
                                        "rates.n=2",
                                        "rates.n_from=start",
                                        "controller.kind=foc",
                                        "controller.angle_source=truth"};
  if (moves != Moves::kTurns) overrides.push_back("reference.speed_rpm=0");
  Config config = Config::load(drive_of(kind), overrides);
  std::vector<Estimate> at = snapshots(config);
  if (moves == Moves::kStill)
    for (Estimate& e : at) {
      e.x_hat.setZero();
      e.omega_m = e.theta_e = 0;
    }
  BackgroundLoop background = make_background_loop(config);
  Correlation seen{.ceiling = background.ceiling()};
  const auto count = static_cast<std::int64_t>(o.covariance);
  const std::clock_t begun = std::clock();
  std::size_t next = 0;
  for (std::int64_t i = 0; i < count && seen.well; ++i) {
    Estimate e = at[next];
    next = next + 1 < at.size() ? next + 1 : 0;
    e.k = 2 * i;
    const Gain& gain = background.step(e);
    if (i % 1000 == 999) seen.take(gain);
  }
  fmt::print("| {} | {:.3g} | {:.2g} | {:.2g} | {:.3g} | {} | {:.0f} s |\n",
             row_name(kind, policy, moves), o.covariance, seen.asymmetry, seen.least_eigenvalue,
             seen.share, seen.well ? "yes" : "NO",
             static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC);
  std::fflush(stdout);
  return seen.well;
}

bool run_covariances(const Options& o) {
  bool well = true;
  fmt::print(
      "| filter, policy, at | updates | C - C' | least eigenvalue of C | of the ceiling | well | "
      "CPU "
      "time |\n"
      "|---|---|---|---|---|---|---|\n");
  for (const std::string& kind : filter_kinds())
    for (const std::string policy : {"paper", "extrapolate", "rotor_frame", "propagated"})
      for (const Moves moves : {Moves::kTurns, Moves::kStands, Moves::kStill}) {
        if (policy == "propagated" && kind != "ekf_sensorless" && kind != "eemf" &&
            kind != "ekf_joint")
          continue;  // it has no steady state in the stationary frame
        if (row_name(kind, policy, moves).find(o.only) == std::string::npos) continue;
        well = run_covariance(o, kind, policy, moves) && well;
      }
  return well;
}

// -- the set over LCM -----------------------------------------------------------------------------

struct Memory {
  double first_MB = 0, most_MB = 0, last_MB = 0;
};

// Of the processes with `run_dir` in an argument, by program.
std::map<std::string, double> memory_of(const std::string& run_dir) {
  std::map<std::string, double> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0 || pid == getpid()) continue;
    std::string text(4096, '\0');
    std::ifstream file(entry.path() / "cmdline", std::ios::binary);
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(file.gcount()));
    if (text.find(run_dir) == std::string::npos) continue;
    const std::string program = fs::path(text.c_str()).filename().string();
    if (program.starts_with("twinrate")) found[program] = resident_MB(entry.path());
  }
  return found;
}

pid_t launch(const Options& o) {
  std::vector<std::string> list = {o.twinrate,
                                   "launch",
                                   o.drive,
                                   "--duration",
                                   "inf",
                                   "--run-dir",
                                   o.run_dir,
                                   "--lcm-url",
                                   url_of_this_process(),
                                   "--set",
                                   "bus.log_rotate_MB=500"};
  for (const std::string& text : o.overrides) list.insert(list.end(), {"--set", text});
  return start(list, "/dev/null");
}

// The messages of the loop in this process, as many on each channel as the log has.
LogDigest digest_of_loop(const Options& o, const LogDigest& log) {
  Config config = Config::load(o.drive, o.overrides);
  ClosedLoop loop(config);
  LogDigest digest;
  const auto add = [&](auto message) {
    const auto channel = static_cast<std::size_t>(kChannelOf<decltype(message)>);
    if (digest.count[channel] < log.count[channel]) digest.add_message(std::move(message));
  };
  const std::int64_t ticks = log.count[static_cast<std::size_t>(Channel::kMeasurement)];
  for (std::int64_t k = 0; k < ticks; ++k) {
    const TickRecord& tick = loop.step();
    add(to_wire(tick.measurement, 0));
    add(to_wire(tick.truth, 0));
    add(to_wire(tick.estimate, 0));
    if (tick.has_gain) add(to_wire(tick.gain, 0));
    add(to_wire(tick.reference, 0));
    add(to_wire(tick.command, 0));
  }
  return digest;
}

std::map<std::string, Memory> watch(const Options& o, pid_t pid) {
  std::map<std::string, Memory> memory;
  const double end_s = 60 * o.minutes, first_s = std::min(60.0, end_s / 2);
  const auto begun = Clock::now();
  while (seconds_since(begun) < end_s && waitpid(pid, nullptr, WNOHANG) == 0) {
    const bool settled = seconds_since(begun) >= first_s;
    for (const auto& [program, MB] : memory_of(o.run_dir)) {
      Memory& m = memory[program];
      if (!settled || m.first_MB == 0) m.first_MB = MB;
      if (settled) m.most_MB = std::max(m.most_MB, MB);
      m.last_MB = MB;
    }
    usleep(1'000'000);
  }
  return memory;
}

bool run_set(Options o) {
  std::string pattern = o.dir + "/endurance-XXXXXX";
  if (!mkdtemp(pattern.data())) throw BadInput("no directory can be made in " + o.dir);
  const fs::path scratch = pattern;
  o.run_dir = (scratch / "run").string();
  const pid_t pid = launch(o);
  const auto memory = watch(o, pid);
  kill(pid, SIGINT);
  int status = 0;
  const bool ended_before = waitpid(pid, &status, 0) != pid;
  const int exit_code = !ended_before && WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  bool well = exit_code == 0 && memory.size() == 6;

  fmt::print(
      "| process | memory after a minute | the most since then | at the end |\n"
      "|---|---|---|---|\n");
  for (const auto& [program, m] : memory) {
    fmt::print("| {} | {:.1f} MB | {:.1f} MB | {:.1f} MB |\n", program, m.first_MB, m.most_MB,
               m.last_MB);
    well = well && m.most_MB - m.first_MB < kGrowth_MB;
  }
  std::ifstream file(fs::path(o.run_dir) / "summary.json");
  const auto summary = nlohmann::json::parse(file);
  std::int64_t lost = 0;
  for (const auto& [channel, count] : summary.at("lost_messages").items())
    lost += count.get<std::int64_t>();
  int parts = 0;
  for (const auto& entry : fs::directory_iterator(o.run_dir))
    parts += entry.path().extension() == ".lcm";
  const LogDigest log = digest_of(o.run_dir);
  const bool equal = digest_of_loop(o, log) == log;
  fmt::print(
      "\n{:.3g} minutes, exit code {}: {} ticks in {} files, {} messages lost ({} sent again); the "
      "log is {} the loop in one process\n",
      o.minutes, exit_code, log.count.front(), parts, lost,
      summary.at("repeats").get<std::int64_t>(), equal ? "bit for bit that of" : "different from");
  std::error_code ignored;
  fs::remove_all(scratch, ignored);
  return well && equal && lost == 0;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("Long runs: memory, losses and state, as a table");
  Options o;
  command_line.option("--drive", &o.drive, "run this drive file or preset");
  command_line.option("--hours", &o.hours, "drive time in this process, in whole hours");
  command_line.option("--set", &o.twinrate, "run the processes of this twinrate's launch");
  command_line.option("--covariance", &o.covariance, "update P of every filter this many times");
  command_line.option("--only", &o.only, "with --covariance: rows with this text in their name");
  command_line.option("--minutes", &o.minutes, "wall time of the set");
  command_line.option("--dir", &o.dir, "write the set's log below this directory");
  command_line.option("--override", &o.overrides,
                      "override a key of the drive file: key.path=value");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (o.covariance > 0) return run_covariances(o) ? 0 : 1;
  return (o.twinrate.empty() ? run_loop(o) : run_set(o)) ? 0 : 1;
} catch (...) {
  return twinrate::report_error("endurance");
}

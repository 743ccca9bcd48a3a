// What a drive does about faults, as a table: fault, trials, detected after, what it did, what was
// lost.
//
//   faults [--drive NAME] [--trials 20] [--seed 1] [--only TEXT] [--set TWINRATE [--messages]]
//
// Each row has its trials at random ticks of a drive that runs. Without --set: in lock-step in this
// process, with the faults of [plant.fault] and of the load. With --set the processes of
// `TWINRATE launch` are killed and stopped, in lock-step and in realtime. With --messages somebody
// else sends to that set (message_faults.cpp).
//
//   detected after   from the fault to the event that names it: worst (median) of the trials. A set
//                    in realtime: from the last GAIN to the event `gain_scheduled`, in drive time
//   off after        lock-step: from the fault to the first interval in mode safe. A set in
//                    realtime: from the last COMMAND, or the last heartbeat of the supervisor where
//                    that is stopped, to it, in drive time
//   end after        from the signal to the end of the five processes, in wall time
//   as expected      trials whose reaction is the one of the row
//
// Exit code 1 if a trial is not as expected.
#include "bench/faults.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>

#include "bench/child.hpp"
#include "bench/command_line.hpp"
#include "core/event_log.hpp"
#include "core/reason.hpp"
#include "core/report_error.hpp"
#include "core/run_log.hpp"
#include "core/seconds_since.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

using namespace faults;

// -- in this process ------------------------------------------------------------------------------

struct LoopRow {
  const char* fault;
  // {t}: the time of the fault.
  std::vector<std::string> overrides;
  Reason names_it;      // the event that names the fault
  Reason switches_off;  // kNone: the drive goes on, locked
  int within;           // ticks from the fault to the event; 0: any
};

const std::vector<LoopRow> kLoopRows = {
    {"COMMAND missing for good",
     {"plant.fault.kind=command_missing"},
     Reason::kCommandLost,
     Reason::kCommandLost,
     22},
    {"COMMAND missing for 10 ticks",
     {"plant.fault.kind=command_missing", "plant.fault.for_s=0.002"},
     Reason::kNone,
     Reason::kNone,
     0},
    {"COMMAND not finite",
     {"plant.fault.kind=command_nan"},
     Reason::kCommandNotFinite,
     Reason::kCommandNotFinite,
     3},
    {"COMMAND beyond the bus, 1 tick",
     {"plant.fault.kind=command_too_large", "plant.fault.value=50", "plant.fault.for_s=0.0002"},
     Reason::kVoltageClamped,
     Reason::kNone,
     2},
    {"COMMAND beyond the bus for good",
     {"plant.fault.kind=command_too_large", "plant.fault.value=50"},
     Reason::kVoltageClamped,
     Reason::kOverCurrent,
     2},
    {"rotor stalled by ten times the rated load",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.63]]"},
     Reason::kNone,
     Reason::kOverCurrent,
     0},
    {"bus at 35 V",
     {"plant.fault.kind=bus_voltage", "plant.fault.value=35"},
     Reason::kOverVoltage,
     Reason::kOverVoltage,
     2},
    {"bus at 8 V",
     {"plant.fault.kind=bus_voltage", "plant.fault.value=8"},
     Reason::kUnderVoltage,
     Reason::kUnderVoltage,
     2},
    {"winding at 110 degC, limit 120 degC, rated load",
     {"plant.fault.kind=temperature", "plant.fault.value=110", "load.T_load_Nm=0.063",
      "safety.temperature_max_degC=120"},
     Reason::kDerated,
     Reason::kNone,
     500},
    {"winding at 121 degC, limit 120 degC",
     {"plant.fault.kind=temperature", "plant.fault.value=121", "safety.temperature_max_degC=120"},
     Reason::kOverTemperature,
     Reason::kOverTemperature,
     500},
    {"load drives it to over-speed",
     {"load.T_load_Nm=[[0, 0], [{t}, -0.15]]", "safety.omega_m_max_rad_s=250"},
     Reason::kOverSpeed,
     Reason::kOverSpeed,
     0},
    {"current NaN for 30 ticks",
     {"plant.fault.kind=current_nan", "plant.fault.for_s=0.006"},
     Reason::kSensorFault,
     Reason::kNone,
     1},
    {"current NaN for good",
     {"plant.fault.kind=current_nan"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     1},
    {"current 10 A off for 30 ticks",
     {"plant.fault.kind=current_jump", "plant.fault.value=10", "plant.fault.for_s=0.006"},
     Reason::kSensorFault,
     Reason::kNone,
     1},
    {"current 10 A off for good",
     {"plant.fault.kind=current_jump", "plant.fault.value=10"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     1},
    {"phase current stuck, under rated load",
     {"plant.fault.kind=current_stuck", "load.T_load_Nm=0.063"},
     Reason::kSensorFault,
     Reason::kSensorLost,
     0},
    {"angle NaN, of a sensor that nobody uses",
     {"plant.fault.kind=position_nan"},
     Reason::kNone,
     Reason::kNone,
     0},
    {"synchronism lost under a stalling load, watch on, i_trip 30 A",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.foc.synchronism.watch=true",
      "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},  // from the first angle error above 90 deg, where there is one
    {"synchronism lost in the same way, lqr",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.kind=lqr",
      "controller.lqr.synchronism.watch=true", "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},
    {"synchronism lost in the same way, reaction stop",
     {"load.T_load_Nm=[[0, 0], [{t}, 0.2]]", "controller.foc.synchronism.watch=true",
      "controller.foc.synchronism.reaction=stop", "machine.i_trip_A=30"},
     Reason::kLostSynchronism,
     Reason::kLostSynchronism,
     100},
};

// What a trial saw of its run.
struct Seen {
  std::int64_t beyond_90 = -1;  // first tick with an angle error above 90 deg
  std::int64_t named = -1, off = -1, safe = -1;
  Reason why = Reason::kNone;
  bool lost_sync = false;
  double i_max = 0;
};

void note(const TickRecord& tick, Reason reason, const LoopRow& row, Seen& seen) {
  if (seen.named < 0 && reason == row.names_it) seen.named = tick.measurement.k;
  if (seen.off < 0 && is_trip(reason)) seen.off = tick.measurement.k, seen.why = reason;
}

Seen watch(Config& config, std::int64_t k_fault, const LoopRow& row) {
  const DriveConfig drive = config.drive();
  ClosedLoop loop(config);
  Seen seen;
  while (loop.k() < drive.steps()) {
    const TickRecord& tick = loop.step();
    if (loop.k() <= k_fault) continue;
    if (tick.event.reason != Reason::kNone) note(tick, tick.event.reason, row, seen);
    for (const PlantEvent& event : tick.plant_events) note(tick, event.reason, row, seen);
    if (seen.safe < 0 && tick.measurement.mode == Mode::kSafe) seen.safe = tick.measurement.k - 1;
    seen.i_max = std::max(seen.i_max, tick.truth.i_dq.norm());
    const double error = wrap_pi(tick.estimate.theta_e - drive.machine.n_p * tick.truth.theta_m);
    if (!(std::abs(error) <= kPi / 2) && !seen.lost_sync) seen.beyond_90 = tick.measurement.k;
    seen.lost_sync = seen.beyond_90 >= 0;
  }
  return seen;
}

Trial try_loop(const Options& o, const LoopRow& row, std::size_t index, int trial) {
  constexpr std::int64_t kFrom = 3000, kTicks = 2000, kAfter = 3000;
  std::int64_t k_fault = kFrom + draw(o, index, trial, kTicks);
  const double f_s = Config::load(o.drive).drive().rates.f_s_Hz;
  const double t = static_cast<double>(k_fault) / f_s;
  std::vector<std::string> list = {
      fmt::format("run.duration_s={}", static_cast<double>(k_fault + kAfter) / f_s),
      fmt::format("run.seed={}", 1 + trial)};
  for (const std::string& text : row.overrides)
    list.push_back(fmt::format(fmt::runtime(text), fmt::arg("t", t)));
  if (row.overrides.front().starts_with("plant.fault"))
    list.push_back(fmt::format("plant.fault.at_s={}", t));
  else
    list.push_back("load.slew_Nm_s=0");
  Config config = load_drive(o.drive, list);
  Seen seen = watch(config, k_fault, row);
  Trial result;
  if (row.names_it == Reason::kLostSynchronism && seen.beyond_90 >= 0) k_fault = seen.beyond_90;
  result.detected = seen.named >= 0;
  result.detected_after = static_cast<double>(seen.named - k_fault);
  if (seen.safe >= 0) result.off_after = static_cast<double>(seen.safe - k_fault);
  const bool named = row.names_it == Reason::kNone || seen.named >= 0;
  const bool in_time = row.within == 0 || seen.named - k_fault <= row.within;
  const bool went_on = row.switches_off == Reason::kNone && seen.off < 0 && !seen.lost_sync;
  result.as_expected = named && in_time &&
                       (row.switches_off == Reason::kNone ? went_on : seen.why == row.switches_off);
  result.did =
      seen.off >= 0 ? fmt::format("off: {}", reason_name(static_cast<int>(seen.why))) : "ran on";
  result.lost = seen.off >= 0 ? "the run" : seen.lost_sync ? "synchronism" : "nothing";
  return result;
}

bool run_loop_rows(const Options& o) {
  bool well = true;
  print_header(false);
  for (std::size_t row = 0; row < kLoopRows.size(); ++row) {
    if (std::string(kLoopRows[row].fault).find(o.only) == std::string::npos) continue;
    std::vector<Trial> trials;
    for (int trial = 0; trial < o.trials; ++trial) {
      trials.push_back(try_loop(o, kLoopRows[row], row, trial));
      well = well && trials.back().as_expected;
    }
    print_row(kLoopRows[row].fault, trials, "ticks", false);
  }
  return well;
}

// -- processes of a set ---------------------------------------------------------------------------

struct SetRow {
  const char* program;  // twinrate: the supervisor
  int signal;
  bool realtime;
  const char* says;  // in the standard error or the log's events
  bool ends;         // the run ends early
};

const std::vector<SetRow> kSetRows = {
    {"twinrate-estimator", SIGKILL, true, "twinrate-estimator ended with signal 9", true},
    {"twinrate-controller", SIGKILL, true, "twinrate-controller ended with signal 9", true},
    {"twinrate-gain", SIGKILL, true, "twinrate-gain ended with signal 9", false},
    {"twinrate-logger", SIGKILL, true, "twinrate-logger ended with signal 9", true},
    {"twinrate-plant", SIGKILL, true, "twinrate-plant ended with signal 9", true},
    {"twinrate-estimator", SIGSTOP, true, "estimator stopped answering", true},
    {"twinrate-controller", SIGSTOP, true, "controller stopped answering", true},
    {"twinrate-gain", SIGSTOP, true, "gain stopped answering", false},
    {"twinrate-logger", SIGSTOP, true, "logger stopped answering", true},
    {"twinrate-plant", SIGSTOP, true, "plant stopped answering", true},
    {"twinrate", SIGKILL, true, "", true},
    {"twinrate", SIGSTOP, true, "the supervisor was silent", true},
    {"twinrate-estimator", SIGKILL, false, "twinrate-estimator ended with signal 9", true},
    {"twinrate-controller", SIGKILL, false, "twinrate-controller ended with signal 9", true},
    {"twinrate-gain", SIGKILL, false, "twinrate-gain ended with signal 9", true},
    {"twinrate-logger", SIGKILL, false, "twinrate-logger ended with signal 9", true},
    {"twinrate-plant", SIGKILL, false, "twinrate-plant ended with signal 9", true},
    {"twinrate-estimator", SIGSTOP, false, "estimator stopped answering", true},
    {"twinrate-controller", SIGSTOP, false, "controller stopped answering", true},
    {"twinrate-gain", SIGSTOP, false, "gain stopped answering", true},
    {"twinrate-logger", SIGSTOP, false, "logger stopped answering", true},
    {"twinrate-plant", SIGSTOP, false, "plant stopped answering", true},
    {"twinrate", SIGKILL, false, "", true},
};

// Processes with `run_dir` in an argument; of `program` where that is given.
std::vector<pid_t> processes_of(const std::string& run_dir, const std::string& program = "") {
  std::vector<pid_t> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0) continue;
    std::string text(4096, '\0');
    std::ifstream file(entry.path() / "cmdline", std::ios::binary);
    file.read(text.data(), static_cast<std::streamsize>(text.size()));  // it may have gone: empty
    text.resize(static_cast<std::size_t>(file.gcount()));
    if (text.find(run_dir) == std::string::npos) continue;
    const std::string first = fs::path(text.c_str()).filename().string();
    if (program.empty() || first == program) found.push_back(pid);
  }
  return found;
}

class Launch {
 public:
  Launch(const Options& o, const SetRow& row, const fs::path& dir, const std::string& duration)
      : dir_(dir), err_(dir.string() + ".err") {
    const std::string url = url_of_this_process();
    std::vector<std::string> list = {o.twinrate,
                                     "launch",
                                     o.drive,
                                     "--run-dir",
                                     dir.string(),
                                     "--duration",
                                     duration,
                                     "--pace",
                                     row.realtime ? "realtime" : "lockstep",
                                     "--lcm-url",
                                     url,
                                     "--set",
                                     "bus.peer_timeout_s=1"};
    pid_ = start(list, "/dev/null", err_);
  }
  ~Launch() {
    for (const pid_t pid : processes_of(dir_.string())) kill(pid, SIGKILL);
    wait_for_end(5);
    std::error_code ignored;
    fs::remove_all(dir_, ignored);
    fs::remove(err_, ignored);
  }
  Launch(const Launch&) = delete;
  Launch& operator=(const Launch&) = delete;

  bool wait_for_log(std::uintmax_t bytes) const {
    const auto begun = Clock::now();
    while (seconds_since(begun) < 30) {
      std::error_code error;
      const auto size = fs::file_size(dir_ / "log.lcm", error);
      if (!error && size > bytes) return true;
      usleep(2000);
    }
    return false;
  }
  pid_t pid_of(const std::string& program) const {
    if (program == "twinrate") return pid_;
    const auto found = processes_of(dir_.string(), program);
    return found.empty() ? -1 : found.front();
  }
  // Seconds until the processes are gone; negative where one is left at the limit.
  double wait_for_end(double limit_s, bool children_only = false) {
    const auto begun = Clock::now();
    while (seconds_since(begun) < limit_s) {
      if (!ended_ && waitpid(pid_, nullptr, WNOHANG) == pid_) ended_ = true;
      auto left = processes_of(dir_.string());
      if (children_only) std::erase(left, pid_);
      if ((ended_ || children_only) && left.empty()) return seconds_since(begun);
      usleep(2000);
    }
    return -1;
  }
  std::string err() const {
    std::ifstream file(err_);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  pid_t pid() const { return pid_; }

 private:
  fs::path dir_;
  std::string err_;
  pid_t pid_ = -1;
  bool ended_ = false;
};

// Ticks of the log, the tick of the last COMMAND, and the first interval that was off; the tick of
// the event that the gain comes from the table, of the last GAIN before it, and of the last heartbeat of the supervisor
// before the drive was off.
struct Logged {
  std::int64_t ticks = 0, last_command = -1, off = -1, table = -1, last_gain = -1, last_beat = -1;
  std::string events;
};
void read_heartbeats(const fs::path& dir, Logged& logged) {
  EventLog log(dir.string(), OnDamage::kSkip);
  std::int64_t k = -1;
  while (const lcm::LogEvent* event = log.next()) {
    if (log.channel() == Channel::kMeasurement)
      k = log.counts()[static_cast<std::size_t>(Channel::kMeasurement)] - 1;
    status_t status{};
    const bool beat = log.channel() == Channel::kStatus &&
                      status.decode(event->data, 0, event->datalen) > 0 &&
                      status.role == static_cast<int>(Role::kSupervisor);
    if (beat && (logged.off < 0 || k < logged.off)) logged.last_beat = k;
  }
}
Logged read_log(const fs::path& dir) {
  Logged logged;
  try {
    const RunLog log = read_run_log(dir.string(), "", OnDamage::kSkip);
    logged.ticks = static_cast<std::int64_t>(log.measurement.size());
    for (const Command& c : log.command)
      if (c.mode != Mode::kSafe) logged.last_command = std::max(logged.last_command, c.k);
    for (const Measurement& m : log.measurement)
      if (m.mode == Mode::kSafe && logged.off < 0) logged.off = m.k - 1;
    for (const EventRecord& e : log.events) {
      logged.events += e.text + "\n";
      if (e.reason == static_cast<int>(Reason::kGainScheduled) && logged.table < 0)
        logged.table = e.k;
    }
    for (const auto& g : log.gain)
      if (g.k < logged.table) logged.last_gain = std::max(logged.last_gain, g.k);
    read_heartbeats(dir, logged);
  } catch (const BadInput& problem) {
    logged.events = problem.what();
  }
  return logged;
}

Trial try_set(const Options& o, const SetRow& row, std::size_t index, int trial,
              const fs::path& scratch) {
  const fs::path dir = scratch / fmt::format("run-{}-{}", index, trial);
  const double f_s = Config::load(o.drive).drive().rates.f_s_Hz;
  const auto k_from = 2000 + draw(o, 100 + index, trial, 2000);
  Launch launch(o, row, dir, row.ends ? "600s" : "3s");
  Trial result;
  result.did = "did not start";
  if (!launch.wait_for_log(static_cast<std::uintmax_t>(k_from) * 900)) return result;
  const pid_t pid = launch.pid_of(row.program);
  if (pid <= 0) return result;
  kill(pid, row.signal);
  const bool frozen_supervisor = pid == launch.pid() && row.signal == SIGSTOP;
  result.end_after = launch.wait_for_end(row.ends ? 10 : 20, true);
  const bool no_orphan = result.end_after >= 0;
  if (!row.ends) result.end_after = -1;
  if (frozen_supervisor) kill(pid, SIGCONT);
  launch.wait_for_end(10);  // its report
  const Logged log = read_log(dir);
  const std::string said = launch.err() + log.events;
  result.detected = said.find(row.says) != std::string::npos;
  // Off before the fault: the machine stalled, and a command came too late.
  const bool by_supervisor = log.events.find("the supervisor is silent") != std::string::npos;
  const bool stalled = log.off >= 0 && log.off < log.last_command && !by_supervisor;
  const bool to_its_end = log.ticks == static_cast<std::int64_t>(3 * f_s);
  result.as_expected = result.detected && no_orphan && (row.ends || to_its_end);
  const auto ms = [f_s](std::int64_t ticks) { return 1e3 * static_cast<double>(ticks) / f_s; };
  if (frozen_supervisor && log.off >= 0 && by_supervisor)
    result.off_after = ms(log.off - log.last_beat);
  else if (row.realtime && log.off >= log.last_command)
    result.off_after = ms(log.off - log.last_command);
  result.detected = row.realtime && !row.ends && log.table >= 0;
  if (result.detected) result.detected_after = ms(log.table - log.last_gain);
  if (row.realtime && !row.ends) result.as_expected = result.as_expected && result.detected;
  result.did = !no_orphan ? "a process was left"
               : row.ends ? "ended"
                          : fmt::format("ran on{}", to_its_end ? "" : ", log short");
  if (stalled) result.did += ", off before by a stall of the machine";
  result.lost = row.ends ? "the rest of the run" : "exactness of the gain";
  return result;
}

std::string name_of(const SetRow& row) {
  const std::string program = row.program;
  return fmt::format(
      "{} {}, {}", program == "twinrate" ? "supervisor" : program.substr(sizeof "twinrate"),
      row.signal == SIGKILL ? "killed" : "frozen", row.realtime ? "realtime" : "lock-step");
}

bool run_set_rows(const Options& o) {
  char pattern[] = "/tmp/faults-XXXXXX";
  const fs::path scratch = mkdtemp(pattern);
  bool well = true;
  print_header(true);
  for (std::size_t row = 0; row < kSetRows.size(); ++row) {
    if (name_of(kSetRows[row]).find(o.only) == std::string::npos) continue;
    std::vector<Trial> trials;
    for (int trial = 0; trial < o.trials; ++trial) {
      trials.push_back(try_set(o, kSetRows[row], row, trial, scratch));
      well = well && trials.back().as_expected;
    }
    print_row(name_of(kSetRows[row]), trials, "ms", true);
  }
  std::error_code ignored;
  fs::remove_all(scratch, ignored);
  return well;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("What a drive does about faults, as a table");
  Options o;
  command_line.option("--drive", &o.drive, "run this drive file or preset");
  command_line.option("--trials", &o.trials, "trials of each row");
  command_line.option("--seed", &o.seed, "draw the ticks from this seed");
  command_line.option("--only", &o.only, "only rows whose name contains this text");
  command_line.option("--set", &o.twinrate, "kill and stop processes of this twinrate's launch");
  command_line.flag("--messages", o.messages,
                    "with --set: send messages of a second sender instead");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (o.messages && o.twinrate.empty()) {
    fmt::print(stderr, "faults: --messages needs --set TWINRATE, whose set it sends them to\n");
    return 2;
  }
  if (o.messages) return run_message_rows(o) ? 0 : 1;
  return (o.twinrate.empty() ? run_loop_rows(o) : run_set_rows(o)) ? 0 : 1;
} catch (...) {
  return twinrate::report_error("faults");
}

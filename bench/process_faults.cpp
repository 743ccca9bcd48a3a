// Processes of a launched set that are killed, stopped or run out of disk: rows of bench/faults.
#include <fmt/format.h>
#include <sched.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "bench/child.hpp"
#include "bench/faults.hpp"
#include "core/config.hpp"
#include "core/event_log.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "core/seconds_since.hpp"

namespace twinrate::faults {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

enum class Action { kKill, kFreeze, kPause, kTakeCpu, kFillDisk };
enum class Outcome {
  kEnds,      // the run ends early
  kTable,     // it goes on to its end, the gain from the table over speed
  kOff,       // it goes on to its end, off
  kStall,     // it goes on to its end, locked, and counts a stall
  kNoLog,     // it goes on to its end, without a log
  kNextPart,  // it goes on to its end, the log in a second part
  kNoSilence  // it goes on to its end, locked; the gain may come from the table
};
constexpr int kPause_ms = 20, kLongPause_ms = 50;  // the latter of the plant
constexpr int kTakenCpu_ms = 120;                  // longer than safety.supervisor_ms

struct SetRow {
  const char* program;  // twinrate: the supervisor
  Action action;
  bool realtime;
  const char* says;  // in the standard error or the log's events
  Outcome outcome;
  std::vector<std::string> overrides = {};
};

const std::vector<SetRow> kSetRows = {
    {"twinrate-estimator", Action::kKill, true, "twinrate-estimator ended with signal 9",
     Outcome::kEnds},
    {"twinrate-controller", Action::kKill, true, "twinrate-controller ended with signal 9",
     Outcome::kEnds},
    {"twinrate-gain", Action::kKill, true, "twinrate-gain ended with signal 9", Outcome::kTable},
    {"twinrate-logger", Action::kKill, true, "twinrate-logger ended with signal 9", Outcome::kEnds},
    {"twinrate-plant", Action::kKill, true, "twinrate-plant ended with signal 9", Outcome::kEnds},
    {"twinrate-estimator", Action::kFreeze, true, "estimator stopped answering", Outcome::kEnds},
    {"twinrate-controller", Action::kFreeze, true, "controller stopped answering", Outcome::kEnds},
    {"twinrate-gain", Action::kFreeze, true, "gain stopped answering", Outcome::kTable},
    {"twinrate-logger", Action::kFreeze, true, "logger stopped answering", Outcome::kEnds},
    {"twinrate-plant", Action::kFreeze, true, "plant stopped answering", Outcome::kEnds},
    {"twinrate", Action::kKill, true, "", Outcome::kEnds},
    {"twinrate", Action::kFreeze, true, "the supervisor was silent", Outcome::kEnds},
    {"twinrate", Action::kTakeCpu, true, "not counted as silence", Outcome::kNoSilence},
    {"twinrate-controller", Action::kPause, true, "no command for more than", Outcome::kOff},
    {"twinrate-estimator", Action::kPause, true, "no command for more than", Outcome::kOff},
    {"twinrate-plant", Action::kPause, true, "", Outcome::kStall},
    {"twinrate-logger",
     Action::kKill,
     true,
     "twinrate-logger ended with signal 9",
     Outcome::kNoLog,
     {"logger.on_loss=go_on"}},
    {"twinrate-logger",
     Action::kFreeze,
     true,
     "logger stopped answering",
     Outcome::kNoLog,
     {"logger.on_loss=go_on"}},
    {"twinrate-logger",
     Action::kKill,
     true,
     "was started again",
     Outcome::kNextPart,
     {"logger.on_loss=restart"}},
    {"twinrate-logger", Action::kFillDisk, true, "the disk is full", Outcome::kEnds},
    {"twinrate-estimator", Action::kKill, false, "twinrate-estimator ended with signal 9",
     Outcome::kEnds},
    {"twinrate-controller", Action::kKill, false, "twinrate-controller ended with signal 9",
     Outcome::kEnds},
    {"twinrate-gain", Action::kKill, false, "twinrate-gain ended with signal 9", Outcome::kEnds},
    {"twinrate-logger", Action::kKill, false, "twinrate-logger ended with signal 9",
     Outcome::kEnds},
    {"twinrate-plant", Action::kKill, false, "twinrate-plant ended with signal 9", Outcome::kEnds},
    {"twinrate-estimator", Action::kFreeze, false, "estimator stopped answering", Outcome::kEnds},
    {"twinrate-controller", Action::kFreeze, false, "controller stopped answering", Outcome::kEnds},
    {"twinrate-gain", Action::kFreeze, false, "gain stopped answering", Outcome::kEnds},
    {"twinrate-logger", Action::kFreeze, false, "logger stopped answering", Outcome::kEnds},
    {"twinrate-plant", Action::kFreeze, false, "plant stopped answering", Outcome::kEnds},
    {"twinrate", Action::kKill, false, "", Outcome::kEnds},
    {"twinrate-logger", Action::kFillDisk, false, "the disk is full", Outcome::kEnds},
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
    for (const std::string& text : row.overrides) list.insert(list.end(), {"--set", text});
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
  std::int64_t ticks = 0, last_tick = -1, last_command = -1, off = -1, table = -1, last_gain = -1,
               last_beat = -1, command_before_off = -1;
  bool voltage_after_off = false;
  std::string events;
};
// What follows from the order of the messages in the log.
void read_in_order(const fs::path& dir, Logged& logged) {
  EventLog log(dir.string(), OnDamage::kSkip);
  std::int64_t k = -1;
  while (const lcm::LogEvent* event = log.next()) {
    if (log.channel() == Channel::kMeasurement)
      k = log.counts()[static_cast<std::size_t>(Channel::kMeasurement)] - 1;
    command_t command{};
    if (log.channel() == Channel::kCommand && k <= logged.off &&
        command.decode(event->data, 0, event->datalen) > 0)
      logged.command_before_off = command.seq;
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
    for (const Measurement& m : log.measurement) {
      if (m.mode == Mode::kSafe && logged.off < 0) logged.off = m.k - 1;
      if (logged.off >= 0 && (m.mode != Mode::kSafe || m.u_alphabeta != Vec2::Zero()))
        logged.voltage_after_off = true;
      logged.last_tick = m.k;
    }
    for (const EventRecord& e : log.events) {
      logged.events += e.text + "\n";
      if (e.reason == static_cast<int>(Reason::kGainScheduled) && logged.table < 0)
        logged.table = e.k;
    }
    for (const auto& g : log.gain)
      if (g.k < logged.table) logged.last_gain = std::max(logged.last_gain, g.k);
    read_in_order(dir, logged);
  } catch (const BadInput& problem) {
    logged.events = problem.what();
  }
  return logged;
}

// Stops a process for so long.
void pause(pid_t pid, int ms) {
  kill(pid, SIGSTOP);
  usleep(1000 * ms);
  kill(pid, SIGCONT);
}

// A program of a higher priority has the CPU of a process for so long: nobody else runs there.
void take_cpu_of(pid_t pid, int ms) {
  std::thread([pid, ms] {
    cpu_set_t cpu;
    sched_param highest{};
    highest.sched_priority = sched_get_priority_max(SCHED_FIFO);
    if (sched_getaffinity(pid, sizeof cpu, &cpu) != 0 ||
        sched_setaffinity(0, sizeof cpu, &cpu) != 0 ||
        sched_setscheduler(0, SCHED_FIFO, &highest) != 0)
      return;
    const auto begun = Clock::now();
    while (1e3 * seconds_since(begun) < ms) {
    }
  }).join();
}

// The file system of the logger takes `bytes` more. SIGXFSZ is ignored, as the set inherits it.
void fill_disk(pid_t logger, const fs::path& log, std::uint64_t bytes) {
  const rlim_t limit = fs::file_size(log) + bytes;
  const rlimit small{.rlim_cur = limit, .rlim_max = limit};
  prlimit(logger, RLIMIT_FSIZE, &small, nullptr);
}

void act(const SetRow& row, pid_t pid, const fs::path& dir, std::uint64_t bytes) {
  switch (row.action) {
    case Action::kKill:
      kill(pid, SIGKILL);
      return;
    case Action::kFreeze:
      kill(pid, SIGSTOP);
      return;
    case Action::kPause:
      return pause(pid, row.outcome == Outcome::kStall ? kLongPause_ms : kPause_ms);
    case Action::kTakeCpu:
      return take_cpu_of(pid, kTakenCpu_ms);
    case Action::kFillDisk:
      return fill_disk(pid, dir / "log.lcm", bytes);
  }
}

// "the log holds 1234 whole ticks", "the log ends before tick 1234"; -1: neither was said.
std::int64_t ticks_said(const std::string& said) {
  for (const char* before : {"the log holds ", "the log ends before tick "})
    if (const auto at = said.find(before); at != std::string::npos)
      return std::atoll(said.c_str() + at + std::string(before).size());
  return -1;
}

// What is wrong with a run that went on; "" if nothing is.
std::string wrong_of(Outcome outcome, const Logged& log, const fs::path& dir, double f_s_Hz) {
  const auto whole = static_cast<std::int64_t>(3 * f_s_Hz);
  std::ifstream file(dir / "summary.json");
  const auto summary = nlohmann::json::parse(file, nullptr, false);
  if (!summary.is_object()) return "no summary";
  if (outcome == Outcome::kNoLog) return log.ticks < whole ? "" : "the log is whole";
  if (outcome == Outcome::kNextPart)
    return !fs::exists(dir / "log-001.lcm") ? "no second part"
           : log.last_tick + 1 != whole     ? "the log ends early"
                                            : "";
  if (log.ticks != whole) return "log short";
  if (outcome == Outcome::kTable) return log.table >= 0 ? "" : "no table";
  if (outcome == Outcome::kOff)
    return log.off < 0 ? "not off" : log.voltage_after_off ? "a voltage after off" : "";
  if (!summary["trip"].is_null()) return "tripped: " + summary["trip"].value("name", "");
  if (outcome == Outcome::kStall &&
      summary.value("longest_stall_s", 0.0) < 1e-3 * kLongPause_ms - 1 / f_s_Hz)
    return "no stall counted";
  return summary.value("locked", false) ? "" : "lost the rotor";
}

constexpr const char* kLost[] = {
    "the rest of the run", "exactness of the gain",      "the rest of the run",  "nothing",
    "the rest of the log", "messages between the parts", "exactness of the gain"};

Trial try_set(const Options& o, const SetRow& row, std::size_t index, int trial,
              const fs::path& scratch) {
  const fs::path dir = scratch / fmt::format("run-{}-{}", index, trial);
  const double f_s = Config::load(o.drive).drive().rates.f_s_Hz;
  const auto k_from = 2000 + draw(o, 100 + index, trial, 2000);
  const bool ends = row.outcome == Outcome::kEnds;
  Launch launch(o, row, dir, ends ? "600s" : "3s");
  Trial result;
  result.did = "did not start";
  if (!launch.wait_for_log(static_cast<std::uintmax_t>(k_from) * 900)) return result;
  const pid_t pid = launch.pid_of(row.program);
  if (pid <= 0) return result;
  act(row, pid, dir, static_cast<std::uint64_t>(draw(o, 400 + index, trial, 300'000)));
  const bool frozen_supervisor = pid == launch.pid() && row.action == Action::kFreeze;
  result.end_after = launch.wait_for_end(ends ? 10 : 20, true);
  const bool no_orphan = result.end_after >= 0;
  if (!ends || row.action == Action::kFillDisk) result.end_after = -1;
  if (frozen_supervisor) kill(pid, SIGCONT);
  launch.wait_for_end(10);  // its report
  const Logged log = read_log(dir);
  const std::string said = launch.err() + log.events;
  std::string wrong = !no_orphan                                 ? "a process was left"
                      : said.find(row.says) == std::string::npos ? "not said"
                      : ends                                     ? ""
                             : wrong_of(row.outcome, log, dir, f_s);
  if (row.action == Action::kFillDisk && wrong.empty() && ticks_said(said) != log.ticks)
    wrong = fmt::format("{} ticks said, {} in the log", ticks_said(said), log.ticks);
  result.as_expected = wrong.empty();
  // Off before the fault: the machine stalled, and a command came too late.
  const bool by_supervisor = log.events.find("the supervisor is silent") != std::string::npos;
  const bool stalled =
      row.outcome != Outcome::kOff && log.off >= 0 && log.off < log.last_command && !by_supervisor;
  const auto ms = [f_s](std::int64_t ticks) { return 1e3 * static_cast<double>(ticks) / f_s; };
  if (frozen_supervisor && log.off >= 0 && by_supervisor)
    result.off_after = ms(log.off - log.last_beat);
  else if (row.outcome == Outcome::kOff && log.off >= 0)
    result.off_after = ms(log.off - log.command_before_off);
  else if (row.realtime && log.off >= log.last_command)
    result.off_after = ms(log.off - log.last_command);
  result.detected = row.outcome == Outcome::kTable && log.table >= 0;
  if (result.detected) result.detected_after = ms(log.table - log.last_gain);
  result.did = !wrong.empty()                 ? wrong
               : ends                         ? "ended"
               : row.outcome == Outcome::kOff ? "off: command_lost"
                                              : "ran on";
  // A run that goes on does not say whether that was before the fault.
  if (stalled)
    result.did += ends ? ", off before by a stall of the machine" : ", off for a late command";
  result.lost = kLost[static_cast<int>(row.outcome)];
  return result;
}

std::string name_of(const SetRow& row) {
  const std::string program = row.program;
  const std::string role = program == "twinrate" ? "supervisor" : program.substr(sizeof "twinrate");
  const std::string pace = row.realtime ? "realtime" : "lock-step";
  if (row.action == Action::kFillDisk) return "disk full, " + pace;
  if (row.action == Action::kTakeCpu)
    return fmt::format("CPU of the {} taken for {} ms, {}", role, kTakenCpu_ms, pace);
  const std::string what =
      row.action == Action::kKill ? "killed"
      : row.action == Action::kFreeze
          ? "frozen"
          : fmt::format("stopped for {} ms",
                        row.outcome == Outcome::kStall ? kLongPause_ms : kPause_ms);
  return fmt::format("{} {}, {}{}", role, what, pace,
                     row.overrides.empty() ? "" : ", " + row.overrides.front());
}

}  // namespace

bool run_set_rows(const Options& o) {
  char pattern[] = "/tmp/faults-XXXXXX";
  const fs::path scratch = mkdtemp(pattern);
  signal(SIGXFSZ, SIG_IGN);  // as a full disk: the set inherits it
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

}  // namespace twinrate::faults

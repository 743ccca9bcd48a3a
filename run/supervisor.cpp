#include "run/supervisor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>

#include "core/authority.hpp"
#include "core/machine_error.hpp"
#include "core/make_event.hpp"
#include "core/realtime_setup.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"
#include "run/cpu_plan.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kStartPatience_s = 10;
constexpr double kBeatPeriod_s = 0.025;  // three and more within safety.supervisor_ms
// Three and a half heartbeats of a process; the run ends half a second after the last one.
constexpr double kFrozenAfter_s = 0.35;
constexpr double kStall_s = 0.1;
constexpr double kKillAfter_s = 1;  // a gain process that hangs for longer is started again
constexpr int kMostRestarts = 3;    // of each process; one that ends again and again stays away

struct Member {
  Role role;
  const char* program;
  bool in_ring;
};
// In the order of their start: a receiver starts before its sender.
constexpr Member kMembers[] = {
    {Role::kLogger, "twinrate-logger", false},
    {Role::kMonitor, "twinrate-monitor", false},
    {Role::kGain, "twinrate-gain", false},
    {Role::kEstimator, "twinrate-estimator", true},
    {Role::kController, "twinrate-controller", true},
    {Role::kPlant, "twinrate-plant", true},
};

}  // namespace

Supervisor::Supervisor(const DriveConfig& drive, SuperviseOptions options)
    : drive_(drive),
      options_(std::move(options)),
      session_(new_session_id()),
      token_(std::in_place, options_.directory + "/" + kTokenFile),
      progress_(drive_, options_.json),
      links_(options_.without) {
  if (options_.bus.shared_memory) memory_.emplace(progress_.visible());
}

std::vector<std::string> Supervisor::arguments(Role role) const {
  std::vector<std::string> list = {"--config",     options_.directory + "/config.toml",
                                   "--session",    std::to_string(session_),
                                   "--pace",       pace_name(),
                                   "--run-dir",    options_.directory,
                                   "--token-file", token_->path()};
  if (!options_.url.empty()) list.insert(list.end(), {"--lcm-url", options_.url});
  if (!options_.channel_suffix.empty())
    list.insert(list.end(), {"--channel-suffix", options_.channel_suffix});
  if (memory_ && role != Role::kMonitor)
    list.insert(list.end(), {"--shared-memory", memory_->path()});
  if (role == Role::kPlant) list.push_back("--wait-for-start");
  return list;
}

bool Supervisor::listens() const {
  return drive_.plant.kind == PlantKind::kBridge && options_.bridge.mode == BridgeMode::kListen;
}

// Of a drive that runs its own control: estimates need its voltage.
bool Supervisor::shadows(Role role) const {
  if (role == Role::kEstimator || role == Role::kGain || role == Role::kMonitor)
    return options_.bridge.tells_voltage();
  return role != Role::kController;
}

// bridge.emulate: the port is an address of this machine that launch chose.
void Supervisor::start_emulator() {
  if (drive_.plant.kind != PlantKind::kBridge || !options_.bridge.emulate) return;
  std::vector<std::string> list = {options_.directory + "/config.toml", "--udp",
                                   options_.bridge.port.substr(std::string("udp://").size())};
  if (listens()) list.push_back("--own-control");
  set_.start(Role::kBridge, "twinrate-emulator", list);
}

// The options that a process of the set is started with.
void Supervisor::say_how_to_start(Role role) const {
  fmt::print(stderr, "waiting for the {}; start it with\n  {}\n",
             kRoleNames[static_cast<int>(role)], fmt::join(arguments(role), " "));
}

bool Supervisor::is_own(Role role) const {
  return std::any_of(options_.own.begin(), options_.own.end(), [role](const OwnProgram& own) {
    return std::find(own.roles.begin(), own.roles.end(), role) != own.roles.end();
  });
}

void Supervisor::start_own() {
  for (const OwnProgram& own : options_.own) {
    std::vector<std::string> list(own.command.begin() + 1, own.command.end());
    for (const std::string& option : arguments(own.roles.front())) list.push_back(option);
    set_.start(own.roles.front(), own.command.front(), list);
  }
}

void Supervisor::start_children() {
  std::optional<PlanLock> planning;
  if (options_.bus.pin) planning.emplace();
  const std::vector<OtherSet> beside = other_sets();
  const CpuPlan cpus = options_.bus.pin ? plan_cpus(allowed_cpus(), beside) : CpuPlan{};
  if (options_.pace == Pace::kRealtime)
    for (const std::string& line : realtime_beside(beside, cpus, options_.url, options_.bus.filter))
      fmt::print(stderr, "twinrate: {}\n", line);
  for (const Member& member : kMembers) {
    if (member.role == Role::kMonitor && !options_.monitor) continue;
    if (options_.without.count(member.role) || is_own(member.role)) continue;
    if (listens() && !shadows(member.role)) continue;
    if (member.role == Role::kPlant) start_emulator();
    const bool real = member.role == Role::kPlant && drive_.plant.kind == PlantKind::kBridge;
    std::vector<std::string> list = arguments(member.role);
    const int cpu = member.in_ring ? cpus.ring : cpus.others;
    if (cpu >= 0) list.insert(list.end(), {"--cpu", std::to_string(cpu)});
    if (member.in_ring && cpus.others >= 0)
      list.insert(list.end(), {"--helper-cpu", std::to_string(cpus.others)});
    set_.start(member.role, real ? "twinrate-bridge" : member.program, list);
  }
  if (const Child* plant = planning ? set_.child(Role::kPlant) : nullptr; plant)
    wait_until_it_shows(plant->pid);
  pinned_ = cpus.others >= 0;
  if (pinned_) pin_to_cpu(cpus.others);
}

// The user's own processes come first: the others wait for a first tick for seconds only.
bool Supervisor::wait_for_own_processes() {
  for (const Role role : options_.without) say_how_to_start(role);
  std::set<Role> awaited = options_.without;
  for (const OwnProgram& own : options_.own) awaited.insert(own.roles.begin(), own.roles.end());
  const auto ready = [this](Role role) { return latest_.count(static_cast<int>(role)) > 0; };
  while (!std::all_of(awaited.begin(), awaited.end(), ready)) {
    bus_->handle(20);
    if (!set_.all_running()) return note_dead_child(), false;
    if (stop_signalled()) return end_early("interrupted");
    if (!facts_.ended.empty()) return false;
  }
  return true;
}

void Supervisor::note_status(const status_t& status) {
  if (status.role == static_cast<int>(Role::kSupervisor)) return;
  latest_[status.role] = status;
  heard_[status.role] = Clock::now();
  const auto sender = static_cast<Role>(status.role);
  // A heartbeat of the one that ended may still be on its way: it was running.
  if (status.state == static_cast<int>(ProcessState::kReady) && rejoining_.erase(sender) > 0)
    publish_event(
        sender == Role::kLogger ? Reason::kLogLost : Reason::kProcessLost,
        fmt::format("{} ended and was started again: it rejoins the run", kRoleNames[status.role]));
  if (all_ready_) return;
  for (const auto& [role, other] : latest_)
    if (other.config_hash != 0 && status.config_hash != 0 &&
        other.config_hash != status.config_hash)
      end_early(fmt::format("{} and {} have different drive files", kRoleNames[status.role],
                            kRoleNames[role]));
}

void Supervisor::request(RequestKind kind) {
  request_t r{};
  r.seq = requests_++;
  r.kind = static_cast<std::int32_t>(kind);
  bus_->publish(r);
}

void Supervisor::note_dead_child() {
  // After a failure exit, waits for the failure events of the other processes: they may name the
  // cause. A plant that has finished is no failure.
  const auto gave_up = [](const Child& c) { return c.exit_code > 0 && c.exit_code < 128; };
  const auto begun = Clock::now();
  if (std::any_of(set_.children().begin(), set_.children().end(), gave_up))
    while (seconds_since(begun) < 0.3) {
      beat();  // the plant would name the silence of this process as the cause
      bus_->handle(20);
    }
  for (const Child& child : set_.children()) {
    if (!child.ended || (child.role == Role::kPlant && child.exit_code == 0)) continue;
    if (ended_.count(child.role)) continue;
    const std::string cause = root_cause();
    end_early(!cause.empty() && child.exit_code < 128
                  ? cause
                  : fmt::format("{} ended with {}", child.program, describe_end(child)));
  }
}

// The loop does not need the monitor. In realtime it can do without two more: the fast loop holds
// its gain and then reads the gain table, and the log is what logger.on_loss says.
bool Supervisor::can_spare(Role role) const {
  const bool realtime = options_.pace == Pace::kRealtime;
  return role == Role::kMonitor || (realtime && role == Role::kGain) ||
         (realtime && role == Role::kLogger && options_.on_log_loss != OnLoss::kStop);
}

// Gain and logger rejoin at the first tick that they hear.
bool Supervisor::start_again(Role role) {
  const bool wanted =
      options_.pace == Pace::kRealtime &&
      (role == Role::kGain || (role == Role::kLogger && options_.on_log_loss == OnLoss::kRestart));
  if (!wanted || restarts_[role] >= kMostRestarts) return false;
  ++restarts_[role];
  try {
    set_.restart(role, role == Role::kLogger ? std::vector<std::string>{"--resume"}
                                             : std::vector<std::string>{});
  } catch (const MachineError&) {
    return false;
  }
  heard_.erase(static_cast<int>(role));
  bus_->forget_sender(role);
  rejoining_.insert(role);
  return true;
}

// An event and the exit code report the end of a process that the drive can spare.
bool Supervisor::continues_without(Role role) {
  const Child* child = set_.child(role);
  if (!child || !child->ended || !can_spare(role)) return false;
  if (ended_.count(role)) return true;
  const std::string end = fmt::format("{} ended with {}", child->program, describe_end(*child));
  // A logger that ended itself has no disk to write to.
  const bool killed = child->exit_code >= 128;
  const bool again = killed && start_again(role);
  if (!again) ended_.insert(role);
  publish_event(role == Role::kLogger ? Reason::kLogLost : Reason::kProcessLost,
                end + (again ? "; the drive goes on, it is started again" : "; the drive goes on"),
                again ? std::optional(role) : std::nullopt);
  return true;
}

void Supervisor::note_failure(const event_t& event) {
  const auto reason = static_cast<Reason>(event.reason);
  const bool ends_the_run = reason == Reason::kPeerTimeout || reason == Reason::kDiskFull ||
                            reason == Reason::kPlantFailed || reason == Reason::kConfigMismatch ||
                            reason == Reason::kSupervisorLost;
  if (ends_the_run && !has_failed(event.role)) failures_.push_back(event);
}

bool Supervisor::has_failed(int role) const {
  return std::any_of(failures_.begin(), failures_.end(),
                     [role](const event_t& failure) { return failure.role == role; });
}

// If one process stops answering, the others time out in turn, each waiting for its predecessor.
// The cause is the process that another one waited for and that reported no failure itself.
std::string Supervisor::root_cause() const {
  for (const event_t& failure : failures_)
    if (failure.waited_for >= 0 && !has_failed(failure.waited_for))
      return fmt::format("{} stopped answering: {}", role_name(failure.waited_for), failure.text);
  return failures_.empty() ? "" : failures_.front().text;
}

// Realtime: the plant switches off where the supervisor is silent for safety.supervisor_ms.
void Supervisor::beat() {
  if (options_.pace != Pace::kRealtime || seconds_since(last_beat_) < kBeatPeriod_s) return;
  last_beat_ = Clock::now();
  status_t status{};
  status.seq = -1;
  status.steps = ++beats_;
  status.role = static_cast<std::int32_t>(Role::kSupervisor);
  status.state = static_cast<std::int32_t>(ProcessState::kRunning);
  bus_->publish(status);
}

void Supervisor::measure_links() {
  if (links_.due(host_now_ns())) bus_->publish(links_.ask(host_now_ns()));
}

// The processes that beat: those of this set and, but for a reference, those that the user started.
std::vector<Role> Supervisor::watched() const {
  std::vector<Role> roles;
  for (const Child& child : set_.children())
    if (!child.ended) roles.push_back(child.role);
  for (const Role role : options_.without)
    if (role != Role::kReference) roles.push_back(role);
  return roles;
}

// Realtime: a process that hangs beats no more. A machine that stalled, this process with it, proves
// nothing: the wait begins anew.
void Supervisor::look_for_silence() {
  if (options_.pace != Pace::kRealtime) return;
  const bool stalled = seconds_since(last_turn_) > kStall_s;
  last_turn_ = Clock::now();
  for (const Role role : watched()) {
    const auto heard = heard_.find(static_cast<int>(role));
    if (heard == heard_.end()) continue;
    if (stalled) heard->second = Clock::now();
    const double silent_s = seconds_since(heard->second);
    const Child* child = set_.child(role);
    if (child && role == Role::kGain && silent_s > kKillAfter_s) kill(child->pid, SIGKILL);
    if (silent_s > kFrozenAfter_s)
      note_silence(role, silent_s);
    else
      silent_.erase(role);
  }
}

void Supervisor::note_silence(Role role, double silent_s) {
  if (!silent_.insert(role).second) return;
  const std::string what = fmt::format(
      "{} stopped answering: no heartbeat for {:.2f} s{}", links_.name_of(role), silent_s,
      options_.without.count(role) ? ", it ended, hangs, or the link to it is lost" : "");
  if (!can_spare(role)) {
    frozen_ = true;
    end_early(what);
    return;
  }
  publish_event(role == Role::kLogger ? Reason::kLogLost : Reason::kProcessFrozen,
                what + "; the drive goes on");
}

bool Supervisor::end_early(const std::string& why) {
  if (facts_.ended.empty()) facts_.ended = why;
  return false;
}

bool Supervisor::wait_until_ready() {
  const auto begun = Clock::now();
  const auto ready = [&](Role role) {
    const auto found = latest_.find(static_cast<int>(role));
    return found != latest_.end() && found->second.state >= static_cast<int>(ProcessState::kReady);
  };
  while (true) {
    bus_->handle(20);
    if (!set_.all_running()) return note_dead_child(), false;
    if (stop_signalled()) return end_early("interrupted");
    if (!facts_.ended.empty()) return false;
    std::string missing;
    for (const Member& member : kMembers)
      if ((set_.child(member.role) || options_.without.count(member.role)) && !ready(member.role))
        missing += (missing.empty() ? "" : ", ") + std::string(member.program);
    if (missing.empty()) return all_ready_ = true;
    if (seconds_since(begun) > std::max(options_.bus.peer_timeout_s, kStartPatience_s))
      return end_early(fmt::format("not ready after {:.1f} s: {}", seconds_since(begun), missing));
  }
}

// As the last heartbeats have them. Losses: messages that this process missed, in realtime also the
// logger; in lock-step the logger asks again for what it misses.
LiveCounters Supervisor::live_counters() const {
  LiveCounters counters;
  counters.losses = bus_->counters().gaps;
  for (const auto& [role, status] : latest_) {
    counters.misses += status.deadline_misses;
    counters.repeats += status.repeats;
    if (options_.pace == Pace::kRealtime && role == static_cast<int>(Role::kLogger))
      counters.losses += status.gaps;
  }
  return counters;
}

void Supervisor::watch() {
  const auto running = [&] {
    const auto plant = latest_.find(static_cast<int>(Role::kPlant));
    return plant != latest_.end() &&
           plant->second.state >= static_cast<int>(ProcessState::kRunning);
  };
  auto last_look = Clock::now() - std::chrono::seconds(1);
  last_turn_ = Clock::now();
  while (true) {
    beat();
    measure_links();
    bus_->handle(20);
    progress_.show(truth_, estimate_, live_counters());
    if (seconds_since(last_look) < 0.02) continue;
    last_look = Clock::now();
    if (!running()) request(RequestKind::kStart);
    if (!set_.all_running() &&
        !std::all_of(set_.children().begin(), set_.children().end(), [this](const Child& child) {
          return !child.ended || continues_without(child.role);
        })) {
      note_dead_child();
      return;
    }
    if (running()) look_for_silence();
    if (stop_signalled()) {
      if (!is_endless(drive_)) end_early("interrupted");
      return;
    }
    if (!facts_.ended.empty()) return;
  }
}

}  // namespace twinrate

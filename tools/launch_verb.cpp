// twinrate launch: the process set over LCM, from start to report.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <sstream>

#include "core/free_udp_port.hpp"
#include "core/machine_error.hpp"
#include "core/multicast.hpp"
#include "core/shared_ring.hpp"
#include "loop/load_drive.hpp"
#include "loop/trial_run.hpp"
#include "monitor/monitor_parameters.hpp"
#include "run/supervisor.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct LaunchOptions {
  std::string drive, run_dir, duration, url, channel_suffix;
  std::string pace = "lockstep";
  std::vector<std::string> overrides, without, own;
  bool json = false, monitor = false, force = false, scope = false, print_pmd = false;
  int scope_port = 8080;
};

// The processes of a lock-step set for libbot's procman, which then starts and stops them.
void print_pmd(const LaunchOptions& o, const std::vector<std::string>& overrides) {
  const bool is_file = std::filesystem::exists(o.drive);
  std::string options =
      "--config " + (is_file ? std::filesystem::absolute(o.drive).string() : o.drive);
  for (const std::string& override : overrides) options += " --set " + override;
  if (!o.url.empty()) options += " --lcm-url " + o.url;
  if (!o.channel_suffix.empty()) options += " --channel-suffix " + o.channel_suffix;
  const std::string out = std::filesystem::absolute(o.run_dir.empty() ? "run" : o.run_dir).string();
  fmt::print("group \"twinrate\" {{\n");
  for (const std::string role : {"logger", "gain", "estimator", "controller", "plant"})
    fmt::print(
        "    cmd \"{0}\" {{\n        exec = \"twinrate-{0} {1}{2}\";\n"
        "        host = \"localhost\";\n    }}\n",
        role, options, role == "logger" ? " --out " + out : "");
  fmt::print("}}\n");
}

std::set<Role> roles_of(const std::vector<std::string>& names) {
  constexpr Role kReplaceable[] = {Role::kPlant, Role::kEstimator, Role::kGain, Role::kController,
                                   Role::kReference};
  std::set<Role> roles;
  for (const std::string& name : names)
    for (const Role role : kReplaceable)
      if (name == role_name(static_cast<int>(role))) roles.insert(role);
  return roles;
}

// ROLE[,ROLE]=COMMAND; the words of the command are parted by spaces.
std::vector<OwnProgram> own_programs(const std::vector<std::string>& texts) {
  const auto split = [](const std::string& text, char at) {
    std::vector<std::string> words;
    std::istringstream in(text);
    for (std::string word; std::getline(in, word, at);)
      if (!word.empty()) words.push_back(word);
    return words;
  };
  std::vector<OwnProgram> list;
  for (const std::string& text : texts) {
    const auto equals = text.find('=');
    OwnProgram own;
    const std::vector<std::string> names = split(text.substr(0, equals), ',');
    const std::set<Role> roles = roles_of(names);
    if (equals != std::string::npos) own.command = split(text.substr(equals + 1), ' ');
    if (names.empty() || roles.size() != names.size() || own.command.empty())
      throw BadInput(
          fmt::format("--own {}: ROLE=COMMAND allowed, ROLE one or more of plant, "
                      "estimator, gain, controller, reference, parted by commas",
                      text));
    own.roles.assign(roles.begin(), roles.end());
    list.push_back(std::move(own));
  }
  return list;
}

// The page is a separate process: the drive continues if it fails.
void start_scope(const LaunchOptions& o, const std::string& directory, ProcessSet& set) {
  std::vector<std::string> arguments = {"scope", "--port", std::to_string(o.scope_port), "--config",
                                        directory + "/config.toml"};
  if (!o.url.empty()) arguments.insert(arguments.end(), {"--lcm-url", o.url});
  if (!o.channel_suffix.empty())
    arguments.insert(arguments.end(), {"--channel-suffix", o.channel_suffix});
  set.start(Role::kSupervisor, "twinrate", arguments);
}

void need_multicast() {
  if (multicast_route_exists("239.255.76.67")) return;
  std::string done;
  if (!try_bring_up_multicast(done))
    throw MachineError("no multicast route, LCM cannot work; as root: " + multicast_mend());
  fmt::print(stderr, "twinrate: {}\n", done);
}

// Under SCHED_FIFO the kernel stops processes that take a whole CPU for 50 ms of each second
// (kernel.sched_rt_runtime_us): the drive would trip.
void check_spin(const Config& config, const RealtimeParameters& realtime) {
  const double tick_us = 1e6 * config.drive().T_s();
  if (2 * realtime.spin_us <= 0.8 * tick_us) return;
  throw BadInput(fmt::format(
      "{}: realtime.spin_us: up to {:g} allowed here (0.4 of a tick: two processes spin on one "
      "CPU), found {:g}",
      config.where("realtime.spin_us"), 0.4 * tick_us, realtime.spin_us));
}

// The keys that options of the verb set.
std::vector<std::string> overrides_of(const LaunchOptions& o, const std::set<Role>& without) {
  std::vector<std::string> overrides = o.overrides;
  if (o.duration == kEndless)
    overrides.push_back(fmt::format("run.duration_s={}", kEndless_s));
  else if (!o.duration.empty())
    overrides.push_back(duration_override(o.duration));
  if (o.monitor) overrides.push_back("monitor.enabled=true");
  if (without.count(Role::kReference)) overrides.push_back("reference.from_bus=true");
  return overrides;
}

// Throws BadInput: no line to a real drive, or a setting that realtime does not allow. Prints the warnings of the trial.
void check_drive(Config& config, Pace pace, bool own_plant) {
  if (config.drive().plant.kind == PlantKind::kBridge && !own_plant &&
      config.read<BridgeParameters>().port.empty())
    throw BadInput(config.where("bridge.port") +
                   ": bridge.port: a serial device or udp://HOST:PORT allowed, found nothing");
  for (const std::string& warning : check_by_trial(config, Trial::kAlways))
    fmt::print(stderr, "twinrate: warning: {}\n", warning);
  if (pace != Pace::kRealtime) return;
  if (config.drive().plant.delay_samples == 0)
    throw BadInput(
        fmt::format("{}: plant.delay_samples: 1 to 4 allowed with --pace realtime, found 0",
                    config.where("plant.delay_samples")));
  check_spin(config, config.read<RealtimeParameters>());
}

// Whoever is not of the set hears the logger's copies alone: he can take no part in a tick.
void check_shared_memory(Config& config, const LaunchOptions& o) {
  const auto bus = config.read<BusParameters>();
  if (!bus.shared_memory) return;
  const auto refuse = [&config](const std::string& allowed) {
    throw BadInput(
        fmt::format("{}: bus.shared_memory: {}", config.where("bus.shared_memory"), allowed));
  };
  if (o.pace == "realtime") refuse("lockstep, wall allowed for --pace, found realtime");
  if (!o.without.empty())
    refuse("allowed without --without: all processes of the set run on one host");
  if (!o.own.empty())
    refuse("allowed without --own: a process of your own has no part in the memory");
  if (o.print_pmd)
    refuse("allowed without --print-pmd: processes that are started by hand have no such memory");
  if (bus.split_ports) refuse("allowed with bus.split_ports = false, found true");
  if (bus.window_ticks > kMostTicksInMemory)
    refuse(fmt::format("bus.window_ticks up to {} allowed with it, found {}", kMostTicksInMemory,
                       bus.window_ticks));
  if (config.drive().plant.kind == PlantKind::kBridge)
    refuse("allowed with plant.kind = simulated, found bridge");
  if (const std::string url = resolve_url(o.url); !url.starts_with("udpm://"))
    refuse(fmt::format("allowed with a URL of the form udpm://ADDRESS:PORT, found {}", url));
}

bool has_own_plant(const std::set<Role>& without, const std::vector<OwnProgram>& own) {
  return without.count(Role::kPlant) ||
         std::any_of(own.begin(), own.end(), [](const OwnProgram& program) {
           return std::count(program.roles.begin(), program.roles.end(), Role::kPlant);
         });
}

int launch(const LaunchOptions& o) {
  const std::set<Role> without = roles_of(o.without);
  const std::vector<OwnProgram> own = own_programs(o.own);  // refused before anything is made
  const std::vector<std::string> overrides = overrides_of(o, without);
  Config config = load_with_port(o.drive, overrides);
  const Pace pace = o.pace == "realtime" ? Pace::kRealtime : Pace::kLockstep;
  check_drive(config, pace, has_own_plant(without, own));
  resolve_url(o.url);
  check_channel_suffix(o.channel_suffix);
  check_shared_memory(config, o);
  if (o.print_pmd) {
    print_pmd(o, overrides);
    return 0;
  }
  need_multicast();
  catch_stop_signals();
  const auto result = make_run_directory(o.run_dir, config, o.force);
  const std::string& directory = result->path();
  ProcessSet page;
  if (o.scope) start_scope(o, directory, page);
  Supervisor supervisor(config.drive(), {.directory = directory,
                                         .url = o.url,
                                         .channel_suffix = o.channel_suffix,
                                         .pace = pace,
                                         .wall = o.pace == "wall",
                                         .json = o.json,
                                         .monitor = config.read<MonitorParameters>().enabled,
                                         .without = without,
                                         .own = own,
                                         .bus = config.read<BusParameters>(),
                                         .bridge = config.read<BridgeParameters>(),
                                         .on_log_loss = config.read<LoggerParameters>().on_loss,
                                         .realtime = config.read<RealtimeParameters>()});
  const RunFacts facts = supervisor.run();
  if (!facts.ended.empty()) fmt::print(stderr, "twinrate: {}\n", facts.ended);
  const int code = conclude_run(directory, config, facts);
  result->finish();
  page.stop({Role::kSupervisor}, 3);
  if (o.scope && !o.json)
    fmt::print("the page ended with the run; to see it again: twinrate scope {}\n", directory);
  return code;
}

}  // namespace

Config load_with_port(const std::string& drive, std::vector<std::string> overrides) {
  Config config = load_drive(drive, overrides);
  const BridgeParameters bridge = config.read<BridgeParameters>();
  if (config.drive().plant.kind != PlantKind::kBridge || !bridge.emulate) return config;
  if (!bridge.port.empty() && !bridge.port.starts_with("udp://"))
    throw BadInput(config.where("bridge.port") +
                   ": bridge.port: udp://HOST:PORT allowed with bridge.emulate = true");
  if (!bridge.port.empty()) return config;
  overrides.push_back(fmt::format("bridge.port=\"udp://127.0.0.1:{}\"", free_udp_port()));
  return load_drive(drive, overrides);
}

int launch_bridge(const BridgeLaunch& b) {
  LaunchOptions o;
  o.drive = b.drive;
  o.run_dir = b.run_dir;
  o.duration = b.duration;
  o.pace = b.pace;
  o.overrides = b.overrides;
  o.force = b.force;
  return launch(o);
}

void add_launch_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<LaunchOptions>();
  CLI::App* verb =
      app.add_subcommand("launch", "Start, supervise and stop the process set of a drive over LCM");
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--duration", o->duration,
                   "set the drive time, e.g. 2s or 500ms; inf: until Ctrl-C");
  verb->add_option("--pace", o->pace,
                   "choose the pace: lockstep, wall (lock-step that does not run ahead of the wall "
                   "clock) or "
                   "realtime")
      ->check(CLI::IsMember({"lockstep", "wall", "realtime"}));
  verb->add_option("--run-dir", o->run_dir,
                   "write the run into this directory (default runs/NAME-DATE)");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_option("--lcm-url", o->url, "use this LCM URL");
  verb->add_option("--channel-suffix", o->channel_suffix, "append this text to every channel name");
  verb->add_option("--without", o->without,
                   "do not start this process, wait for yours: plant, estimator, gain, controller "
                   "or reference; repeat for more")
      ->check(CLI::IsMember({"plant", "estimator", "gain", "controller", "reference"}))
      ->allow_extra_args(false);
  verb->add_option("--own", o->own,
                   "start this command in the place of a process, with its options: "
                   "ROLE[,ROLE]=COMMAND; repeat for more")
      ->allow_extra_args(false);
  verb->add_flag("--monitor", o->monitor,
                 "start twinrate-monitor with the set (as monitor.enabled = true)");
  verb->add_flag("--scope", o->scope, "show the drive on a page, as twinrate scope does");
  verb->add_option("--scope-port", o->scope_port, "serve it on this port (default 8080; 0: any)")
      ->check(CLI::Range(0, 65535));
  verb->add_flag("--print-pmd", o->print_pmd,
                 "print the processes as a file of libbot's procman, and start none");
  verb->add_flag("--force", o->force, "replace the run that the directory holds");
  verb->add_flag("--json", o->json, "print progress as JSON lines");
  verb->callback([o, &exit_code] { exit_code = launch(*o); });
}

}  // namespace twinrate

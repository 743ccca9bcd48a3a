// twinrate replay: replays a recorded log to the processes.
//
//   --lockstep   sends MEASUREMENT(k), waits for ESTIMATE(k), compares it bit for bit with the
//                logged one
//   --speed X    sends the messages at the log's time stamps, X times as fast (default 1)
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/machine_error.hpp"
#include "core/process.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "core/run_log_part.hpp"
#include "core/signals_io.hpp"
#include "core/steering.hpp"
#include "loop/load_drive.hpp"
#include "loop/replay.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct ReplayOptions {
  std::string log, only = "MEASUREMENT,REFERENCE,TRUTH";
  BusAddress bus;
  double speed = 1;
  bool lockstep = false, repair = false, json = false;
};

// manifest.json counts the messages of the log, also of a log whose writer was killed. Only an
// event in the log itself shows that nothing came after it.
bool ends_with_a_stop(const RunLog& log) {
  return std::any_of(log.events.begin(), log.events.end(), [](const EventRecord& event) {
    return event.reason == static_cast<int>(Reason::kStopRequested);
  });
}

// Why the logged estimates are not those of a whole run; empty if they are, or if there are none.
std::string incomplete(const RunLog& log, const DriveConfig& drive) {
  if (log.estimate.empty()) return "";
  if (!log.damage.empty()) return "the log is damaged";
  const auto ticks = std::ssize(log.measurement);
  if (ticks == 0) return "the log holds no MEASUREMENT";
  const std::int64_t first = log.measurement.front().k, last = log.measurement.back().k;
  if (first != 0 || last - first + 1 != ticks)
    return fmt::format("the log holds {} of the ticks 0 to {}", ticks, last);
  if (std::ssize(log.estimate) != ticks)
    return fmt::format("the log holds {} estimates for {} ticks", log.estimate.size(), ticks);
  if (ticks != drive.steps() && !ends_with_a_stop(log))
    return fmt::format("the log holds {} of {} ticks and no event that says the run was stopped",
                       ticks, drive.steps());
  return "";
}

int print(const LockstepResult& r, const BusParameters& parameters, const std::string& incomplete,
          bool json) {
  if (r.unanswered_k >= 0) {
    fmt::print(stderr,
               "twinrate: no ESTIMATE({}) from an estimator within {} s; a running "
               "estimator must be unbound, and started with --follow to hear a second session\n",
               r.unanswered_k, parameters.peer_timeout_s);
    return 1;
  }
  const int code = r.different > 0 || !incomplete.empty() ? 1 : 0;
  if (json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"ticks", r.played},
                                              {"wall_s", r.wall_s},
                                              {"repeats", r.repeats},
                                              {"equal", r.equal},
                                              {"different", r.different},
                                              {"not_whole", incomplete}}
                           .dump());
    return code;
  }
  fmt::print("replayed {} ticks in {:.2f} s, {} sent again\n", r.played, r.wall_s, r.repeats);
  if (r.equal + r.different == 0)
    fmt::print("estimates: none {}\n",
               incomplete.empty() ? "in the log to compare with" : "compared");
  else
    fmt::print("estimates: {} {}, {} different, {} not in the log\n", r.equal,
               incomplete.empty() ? "equal to the log bit for bit" : "equal", r.different,
               r.played - r.equal - r.different);
  if (!incomplete.empty()) fmt::print("not a whole run: {}\n", incomplete);
  if (r.different > 0) fmt::print("first difference at tick {}\n", r.first_difference_k);
  return code;
}

std::vector<std::string> channel_list(const std::string& text) {
  std::vector<std::string> names;
  std::stringstream in(text);
  for (std::string name; std::getline(in, name, ',');) {
    if (name.rfind("DRIVE_", 0) != 0) name.insert(0, "DRIVE_");
    const bool known = std::any_of(kChannels.begin(), kChannels.end(),
                                   [&](const ChannelInfo& c) { return c.name == name; });
    if (!known) throw BadInput(fmt::format("--only {}: no such channel", name));
    names.push_back(name);
  }
  if (names.empty()) throw BadInput("--only: at least one channel allowed, found none");
  return names;
}

void print_paced(const PacedResult& r, const ReplayOptions& o) {
  if (o.json)
    fmt::print("{}\n", nlohmann::ordered_json{{"messages", r.played},
                                              {"channels", o.only},
                                              {"wall_s", r.wall_s},
                                              {"interrupted", stop_signalled()}}
                           .dump());
  else
    fmt::print("played {} messages of {} in {:.2f} s{}\n", r.played, o.only, r.wall_s,
               stop_signalled() ? ", interrupted" : "");
}

int compare_in_lockstep(const RunLog& log, const ReplayOptions& o) {
  if (log.config_toml.empty())
    throw BadInput(fmt::format("{}: no DRIVE_MANIFEST in this log; play it with --speed", o.log));
  if (log.measurement.empty())
    throw BadInput(fmt::format("{}: no MEASUREMENT in this log; nothing to replay", o.log));
  Config config = Config::parse(log.config_toml, o.log + " (DRIVE_MANIFEST)");
  read_all_tables(config);
  const std::string drive_file =
      was_steered(log) ? steered_drive_file(log, false) : log.config_toml;
  const BusParameters parameters = config.read<BusParameters>();
  std::unique_ptr<OwnEstimator> own;
  const std::int64_t session = new_session_id();
  if (!estimator_on_bus(o.bus)) {
    fmt::print(o.json ? stderr : stdout,
               "no estimator on the bus: starting estimator and gain with the config of the log\n");
    own = std::make_unique<OwnEstimator>(drive_file, o.bus, session);
  }
  const LockstepResult result = replay_lockstep(log, parameters, o.bus, session);
  std::string why = incomplete(log, config.drive());
  if (why.empty() && stop_signalled())
    why = fmt::format("interrupted after {} of {} ticks", result.played, log.measurement.size());
  return print(result, parameters, why, o.json);
}

int replay(const ReplayOptions& o) {
  catch_stop_signals();
  resolve_url(o.bus.url);
  check_channel_suffix(o.bus.channel_suffix);
  const OnDamage on_damage = o.repair ? OnDamage::kSkip : OnDamage::kRefuse;
  // Only lock-step compares: a paced replay reads the log once before, for damage, and keeps nothing.
  const RunLog log = o.lockstep
                         ? read_run_log(o.log, "", on_damage)
                         : scan_run_log(o.log, "", on_damage, [](Channel, const lcm::LogEvent&) {});
  if (!log.damage.empty()) fmt::print(stderr, "twinrate: {}\n", log.damage);
  if (o.lockstep) return compare_in_lockstep(log, o);
  print_paced(
      replay_paced(o.log, log.channel_suffix, channel_list(o.only), o.bus, o.speed, on_damage), o);
  return log.damage.empty() ? 0 : 1;
}

}  // namespace

void add_replay_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<ReplayOptions>();
  CLI::App* verb = app.add_subcommand("replay", "Play a log to the running processes");
  verb->add_option("LOG", o->log, "play this run directory or log file")->required();
  auto* speed = verb->add_option("--speed", o->speed, "play at this multiple of the recorded speed")
                    ->check(CLI::Range(0.001, 1000.0));
  verb->add_flag("--lockstep", o->lockstep, "wait for each estimate and compare it with the log")
      ->excludes(speed);
  verb->add_option(
      "--only", o->only,
      "play these channels only, separated by commas (default MEASUREMENT,REFERENCE,TRUTH)");
  verb->add_flag("--repair", o->repair, "play the undamaged part of a log; exit code 1");
  verb->add_flag("--json", o->json, "print the result as one line of JSON");
  verb->add_option("--lcm-url", o->bus.url, "use this LCM URL");
  verb->add_option("--channel-suffix", o->bus.channel_suffix,
                   "append this text to every channel name");
  verb->callback([o, &exit_code] { exit_code = replay(*o); });
}

}  // namespace twinrate

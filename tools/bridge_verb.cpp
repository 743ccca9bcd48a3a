// twinrate bridge: a real drive on its line.
//
//   probe    the drive's answer, its rate, the errors of frames on the line; --clear leaves the off
//            state
//   listen   the drive runs its own control: estimator and logger shadow it
//   run      the host closes the loop: as launch with plant.kind = bridge
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <vector>

#include "bridge/conversation.hpp"
#include "core/machine_error.hpp"
#include "core/process.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct BridgeOptions {
  std::string drive, port, protocol, run_dir, duration;
  std::string pace = "lockstep";
  std::vector<std::string> overrides;
  int clear = 0;
  double for_s = 4;
  bool force = false, json = false;
};

using Json = nlohmann::ordered_json;

nlohmann::ordered_json or_null(const char* text) {
  return text ? Json(text) : Json(nullptr);
}

std::vector<std::string> overrides_of(const BridgeOptions& o, const char* mode) {
  std::vector<std::string> list = o.overrides;
  list.insert(list.end(), {"plant.kind=bridge", std::string("bridge.mode=") + mode});
  if (!o.port.empty()) list.push_back("bridge.port=\"" + o.port + "\"");
  if (!o.protocol.empty()) list.push_back("bridge.protocol=" + o.protocol);
  return list;
}

// In mode listen, watchdog and voltage vectors are not reported.
void print_info(const DriveInfo& info, const std::string& port, const BridgeParameters& bridge) {
  fmt::print("{}: {}\n", port, info.name.empty() ? "(no name)" : info.name);
  if (info.f_s_Hz > 0) fmt::print("  control rate   {:g} Hz\n", info.f_s_Hz);
  if (bridge.takes_commands() &&
      (bridge.protocol != DriveProtocol::kTwinrate || info.takes_voltage || info.takes_duties)) {
    fmt::print("  watchdog       {}\n",
               info.watchdog ? fmt::format("in the drive, lease up to {:g} ms", info.lease_max_ms)
                             : "none: the drive keeps its last command if the host ends; not safe");
    fmt::print("  takes          {}\n", info.takes_voltage  ? "voltage vectors"
                                        : info.takes_duties ? "duties"
                                                            : "no voltage vector");
  } else {
    fmt::print("  takes          no command of this host: it is listened to alone\n");
  }
  const char* reason = reason_name(info.reason);
  fmt::print("  state          {}\n",
             info.reason == 0 ? "not latched"
                              : fmt::format("off, latched: {} (--clear {} leaves it)",
                                            reason ? reason : "unknown reason", info.reason));
  fmt::print("  counts         {} frames refused, {} missing\n", info.bad_frames, info.lost_frames);
}

Json json_of(const DriveInfo& info, const std::string& port) {
  return {{"event", "drive"},
          {"port", port},
          {"name", info.name},
          {"f_s_Hz", info.f_s_Hz > 0 ? Json(info.f_s_Hz) : Json(nullptr)},
          {"watchdog", info.watchdog},
          {"lease_max_ms", info.watchdog ? Json(info.lease_max_ms) : Json(nullptr)},
          {"takes_voltage", info.takes_voltage},
          {"takes_duties", info.takes_duties},
          {"reason", info.reason},
          {"reason_name", info.reason == 0 ? Json(nullptr) : or_null(reason_name(info.reason))},
          {"frames_refused", info.bad_frames},
          {"frames_missing", info.lost_frames}};
}

void print_line(const Json& json) {
  std::cout << json.dump() << std::endl;
}

// Clears by hand; reports the result.
int clear(Conversation& talk, int reason, bool json) {
  constexpr double kPatience_ms = 2000, kAskAgain_ms = 200;
  const bool was_latched = talk.protocol().info()->reason != 0;
  talk.protocol().forget_info();
  const std::int64_t begun = now_ns();
  const auto waited_ms = [](std::int64_t from) {
    return 1e-6 * static_cast<double>(now_ns() - from);
  };
  while (!talk.protocol().info() && waited_ms(begun) < kPatience_ms) {
    talk.link().send(talk.protocol().clear(reason));
    for (const std::int64_t asked = now_ns();
         !talk.protocol().info() && waited_ms(asked) < kAskAgain_ms;)
      talk.pump(10);
  }
  if (!talk.protocol().info()) throw MachineError("no answer to the clear");
  const int left = talk.protocol().info()->reason;
  if (json) {
    print_line({{"event", "clear"},
                {"reason", reason},
                {"was_latched", was_latched},
                {"left_reason", left}});
    return left == 0 ? 0 : 1;
  }
  fmt::print("  clear {}       {}\n", reason,
             left != 0     ? fmt::format("refused: the latched reason is {}", left)
             : was_latched ? "done"
                           : "nothing was latched");
  return left == 0 ? 0 : 1;
}

struct Spread {
  std::vector<double> late_us;
  double at(double share) {
    if (late_us.empty()) return 0;
    std::sort(late_us.begin(), late_us.end());
    return late_us[static_cast<std::size_t>(share * static_cast<double>(late_us.size() - 1))];
  }
};

constexpr int kMostTrips = 1000;  // p99.9 is the second largest of them
constexpr double kPatience_ms = 100;

struct RoundTrips {
  Spread spread;
  int asked = 0;
  int unanswered() const { return asked - static_cast<int>(spread.late_us.size()); }
  bool none() const { return spread.late_us.empty(); }
};

// Question and answer again and again, for `for_s`: the delay that the lease has to bridge.
RoundTrips ask_round_trips(Conversation& talk, double for_s) {
  RoundTrips trips;
  for (const std::int64_t begun = now_ns(); trips.asked < kMostTrips && !stop_signalled() &&
                                            1e-9 * static_cast<double>(now_ns() - begun) < for_s;
       ++trips.asked) {
    if (const auto us = talk.round_trip_us(kPatience_ms)) trips.spread.late_us.push_back(*us);
    while (talk.next()) {  // watch() does not count the samples of this time
    }
  }
  return trips;
}

Json to_json(RoundTrips& trips) {
  const auto at = [&](double share) {
    return trips.none() ? Json(nullptr) : Json(trips.spread.at(share));
  };
  return {{"event", "round_trip"},
          {"asked", trips.asked},
          {"not_answered", trips.unanswered()},
          {"p50_us", at(0.5)},
          {"p99_us", at(0.99)},
          {"p999_us", trips.asked < kMostTrips ? Json(nullptr) : at(0.999)}};
}

void print_lease(const BridgeParameters& bridge, const RoundTrips& trips, double p999_ms) {
  const double least_ms = BridgeParameters::kLeaseRoundTrips * p999_ms;
  if (trips.asked < kMostTrips)
    fmt::print("  lease          not judged: {} round trips are too few for a p99.9\n",
               trips.asked);
  else
    fmt::print(
        "  lease          bridge.lease_ms = {:g} is {} three times the p99.9 ({:.2g} ms){}\n",
        bridge.lease_ms, bridge.lease_ms < least_ms ? "below" : "above", least_ms,
        bridge.lease_ms < least_ms ? ": too short for this link" : "");
}

void measure_round_trips(Conversation& talk, const BridgeParameters& bridge, double for_s,
                         bool json) {
  if (talk.protocol().hello(false).empty()) {
    if (!json) fmt::print("  round trip     not asked: a drive that only sends\n");
    return;
  }
  RoundTrips trips = ask_round_trips(talk, for_s);
  if (json) print_line(to_json(trips));
  if (trips.none()) {
    if (!json)
      fmt::print("  round trip     none of {} questions answered within {:g} ms\n", trips.asked,
                 kPatience_ms);
    return;
  }
  const double p999_ms = 1e-3 * trips.spread.at(0.999);
  if (!json)
    fmt::print(
        "  round trip     {:.0f} us p50, {:.0f} us p99, {:.0f} us p99.9; {} of {} not answered\n",
        trips.spread.at(0.5), trips.spread.at(0.99), 1e3 * p999_ms, trips.unanswered(),
        trips.asked);
  talk.greet(false, 2);  // the last one may be lost
  if (!json && talk.protocol().info()->watchdog) print_lease(bridge, trips, p999_ms);
}

// Listens for a while: rate, faults, clock, spread of the arrivals.
int watch(Conversation& talk, double for_s, double f_s_Hz, bool json) {
  Spread spread;
  std::int64_t samples = 0, begun = now_ns();
  while (!stop_signalled() && 1e-9 * static_cast<double>(now_ns() - begun) < for_s) {
    talk.pump(20);
    while (const auto sample = talk.next()) {
      ++samples;
      if (talk.protocol().clock().known())
        spread.late_us.push_back(
            1e-3 * static_cast<double>(sample->arrival_ns -
                                       talk.protocol().clock().host_ns(sample->time_us)));
    }
  }
  const double seconds = 1e-9 * static_cast<double>(now_ns() - begun);
  if (json) {
    const bool timed = !spread.late_us.empty();
    print_line({{"event", "samples"},
                {"samples", samples},
                {"seconds", seconds},
                {"rate_Hz", static_cast<double>(samples) / seconds},
                {"f_s_Hz", f_s_Hz},
                {"line", talk.account()},
                {"arrival_p50_us", timed ? Json(spread.at(0.5)) : Json(nullptr)},
                {"arrival_p99_us", timed ? Json(spread.at(0.99)) : Json(nullptr)}});
    return samples > 0 ? 0 : 1;
  }
  fmt::print("  samples        {} in {:.1f} s: {:.0f} a second of {:g}\n", samples, seconds,
             static_cast<double>(samples) / seconds, f_s_Hz);
  fmt::print("  line           {}\n", talk.account());
  if (!spread.late_us.empty())
    fmt::print("  arrival        {:.0f} us p50, {:.0f} us p99 behind the earliest\n",
               spread.at(0.5), spread.at(0.99));
  return samples > 0 ? 0 : 1;
}

int probe(const BridgeOptions& o) {
  Config config = load_drive(o.drive, overrides_of(o, "listen"));
  const BridgeParameters bridge = config.read<BridgeParameters>();
  catch_stop_signals();
  Conversation talk(bridge, config.drive());
  const DriveInfo& info = talk.greet(false, 2);
  if (o.json)
    print_line(json_of(info, bridge.port));
  else
    print_info(info, bridge.port, bridge);
  if (o.clear != 0) return clear(talk, o.clear, o.json);
  measure_round_trips(talk, bridge, o.for_s, o.json);
  return watch(talk, o.for_s, config.drive().rates.f_s_Hz, o.json);
}

void add_common(CLI::App* verb, BridgeOptions& o) {
  verb->add_option("DRIVE", o.drive, "use this drive file or preset")->required();
  verb->add_option("--port", o.port, "use this line: a serial device or udp://HOST:PORT");
  verb->add_option("--protocol", o.protocol, "speak this protocol: twinrate, moteus, vesc");
  verb->add_option("--set", o.overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
}

void add_run_options(CLI::App* verb, BridgeOptions& o) {
  add_common(verb, o);
  verb->add_option("--duration", o.duration, "set the drive time, e.g. 2s or 500ms");
  verb->add_option("--run-dir", o.run_dir, "write the run into this directory");
  verb->add_flag("--force", o.force, "replace the run that the directory holds");
}

}  // namespace

void add_bridge_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<BridgeOptions>();
  CLI::App* verb = app.add_subcommand("bridge", "Probe, shadow or drive a real drive on its line");
  verb->require_subcommand(1);
  CLI::App* probe_verb = verb->add_subcommand(
      "probe", "Show the drive on the line: name, rate, round trip, bad frames");
  add_common(probe_verb, *o);
  probe_verb->add_option("--for", o->for_s, "listen for this time, s")
      ->check(CLI::Range(0.1, 3600.0));
  probe_verb->add_option("--clear", o->clear, "leave the off state that this reason code latched")
      ->check(above_zero());
  probe_verb->add_flag("--json", o->json, "print JSON lines: drive, round_trip, samples");
  probe_verb->callback([o, &exit_code] { exit_code = probe(*o); });
  CLI::App* listen_verb =
      verb->add_subcommand("listen", "Shadow a drive that runs its own control");
  add_run_options(listen_verb, *o);
  listen_verb->callback([o, &exit_code] {
    exit_code = launch_bridge(
        {o->drive, o->run_dir, o->duration, "realtime", overrides_of(*o, "listen"), o->force});
  });
  CLI::App* run_verb = verb->add_subcommand("run", "Close the loop over the line");
  add_run_options(run_verb, *o);
  run_verb
      ->add_option("--pace", o->pace, "choose the pace: lockstep (an emulated drive) or realtime")
      ->check(CLI::IsMember({"lockstep", "realtime"}));
  run_verb->callback([o, &exit_code] {
    exit_code = launch_bridge(
        {o->drive, o->run_dir, o->duration, o->pace, overrides_of(*o, "control"), o->force});
  });
}

}  // namespace twinrate

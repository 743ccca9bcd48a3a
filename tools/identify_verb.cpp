// twinrate identify DRIVE.toml --out DIR: an unknown motor to a drive file.
#include <fmt/format.h>
#include <unistd.h>

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/process_set.hpp"
#include "core/realtime_setup.hpp"
#include "core/result_directory.hpp"
#include "identify/bridge_rig.hpp"
#include "identify/identify.hpp"
#include "identify/simulated_rig.hpp"
#include "loop/load_drive.hpp"
#include "plant_sim/safety_parameters.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct IdentifyOptions {
  std::string drive, out, on = "simulated", sheet, port, pace = "auto";
  std::vector<std::string> overrides;
  double current = 0, speed_rpm = 0;
  Wiring wiring;
  bool force = false, json = false;
};

// A limit beyond the one at which the drive switches itself off would not be one.
void expect_below_trips(const IdentifyOptions& o, Config& drive) {
  const SafetyLimits trips = safety_limits(drive, drive.read<SafetyParameters>(), 0);
  if (o.current > trips.i_trip)
    throw BadInput(
        fmt::format("--current: above 0 and up to {:.4g} A, where the drive switches off, allowed, "
                    "found {:g}",
                    trips.i_trip, o.current));
  if (o.speed_rpm * kTwoPi / 60 > trips.omega_m_max)
    throw BadInput(
        fmt::format("--max-speed: above 0 and up to {:.4g} rpm, where the drive switches off, "
                    "allowed, found {:g}",
                    trips.omega_m_max * 60 / kTwoPi, o.speed_rpm));
}

IdentifyLimits limits(const IdentifyOptions& o, const DriveConfig& sheet) {
  IdentifyLimits l = limits_of(sheet);
  if (o.current > 0) l.i_max = o.current;
  if (o.speed_rpm > 0) l.omega_m_max = o.speed_rpm * kTwoPi / 60;
  return l;
}

IdentifyHooks hooks(const IdentifyOptions& o) {
  IdentifyHooks h;
  const bool draws = !o.json && isatty(STDERR_FILENO) != 0;
  h.progress = [json = o.json, draws](const std::string& what, double share) {
    if (json)
      std::cout << nlohmann::json{{"progress", what}, {"share", share}}.dump() << std::endl;
    else if (draws)
      fmt::print(stderr, "\r\033[K{} {:.0f} %", what, 100 * share);
  };
  h.stop = stop_signalled;
  return h;
}

std::vector<std::string> bridge_overrides(const IdentifyOptions& o) {
  std::vector<std::string> list = o.overrides;
  list.insert(list.end(), {"plant.kind=bridge", "bridge.mode=control"});
  if (!o.port.empty()) list.push_back("bridge.port=\"" + o.port + "\"");
  return list;
}

// Overrides of inverter, sensors and rates by --set; they are no secret of the motor.
std::vector<std::string> rig_overrides(const IdentifyOptions& o) {
  std::vector<std::string> list;
  for (const std::string& item : o.overrides)
    for (const char* table : {"inverter.", "sensors.", "rates."})
      if (item.starts_with(table)) list.push_back(item);
  return list;
}

// The motor of the experiments, and the emulated drive behind a bridge with bridge.emulate.
struct Bench {
  ProcessSet emulator;
  std::unique_ptr<Rig> rig;
  BridgeRig* bridge = nullptr;
  std::string name = "the simulated plant";
};

// The shaft of an emulated drive is free and at rest, as that of the simulated rig.
void start_emulator(const std::string& drive, const std::string& udp,
                    const std::vector<std::string>& overrides, ProcessSet& set) {
  std::vector<std::string> list = {drive, "--udp", udp};
  for (const std::string& item : overrides) list.insert(list.end(), {"--set", item});
  for (const char* item : {"load.T_load_Nm=0.0", "start=aligned"})
    list.insert(list.end(), {"--set", item});
  set.start(Role::kBridge, "twinrate-emulator", list);
}

void put_on_bridge(const IdentifyOptions& o, Config& drive, Bench& bench) {
  const auto bridge = drive.read<BridgeParameters>();
  if (bridge.emulate)
    start_emulator(o.drive, bridge.port.substr(std::string("udp://").size()), bridge_overrides(o),
                   bench.emulator);
  const RigPace pace = o.pace == "lockstep"   ? RigPace::kLockstep
                       : o.pace == "realtime" ? RigPace::kRealtime
                                              : RigPace::kAuto;
  if (pace != RigPace::kLockstep && !bridge.emulate) {
    const auto realtime = drive.read<RealtimeParameters>();
    if (realtime.lock_memory) lock_memory();
    take_fifo(fifo_priority(realtime, Role::kPlant));
  }
  auto rig = std::make_unique<BridgeRig>(drive, pace, stop_signalled);
  bench.name =
      fmt::format("{} ({})", bridge.emulate ? "an emulated drive" : "the drive", rig->where());
  bench.bridge = rig.get();
  bench.rig = std::move(rig);
}

void write_results(const IdentifyOptions& o, ResultDirectory& directory, const Config& sheet,
                   const Identified& found, const std::string& title) {
  const auto rows = compare(found, sheet.drive().machine);
  const std::string text = title + identified_text(found, rows);
  directory.begin();
  write_new(o.out + "/identified.toml", identified_toml(sheet, found));
  write_new(o.out + "/identify.json", identified_json(found, rows));
  write_new(o.out + "/identify.txt", text);
  directory.finish();
  if (o.json)
    std::cout << nlohmann::json{{"out", o.out}}.dump() << "\n";
  else
    fmt::print("{}written to {}: identified.toml, identify.json, identify.txt\n", text, o.out);
}

void check_options(const IdentifyOptions& o) {
  if (o.on == "bridge" && (o.wiring.swapped_phases || o.wiring.reversed_encoder))
    throw BadInput("--swap-phases, --reverse-encoder: allowed with --on simulated alone");
  if (o.on != "bridge" && (!o.port.empty() || o.pace != "auto"))
    throw BadInput("--port, --pace: allowed with --on bridge alone");
}

int run(const IdentifyOptions& o) {
  check_options(o);
  Config drive = o.on == "bridge" ? load_with_port(o.drive, bridge_overrides(o))
                                  : load_drive(o.drive, o.overrides);
  expect_below_trips(o, drive);
  const Config sheet = load_drive(o.sheet.empty() ? o.drive : o.sheet, rig_overrides(o));
  ResultDirectory directory(o.out, ResultKind::kIdentify, o.force);
  catch_stop_signals();
  Bench bench;
  Identified found;
  try {
    if (o.on == "bridge")
      put_on_bridge(o, drive, bench);
    else
      bench.rig = std::make_unique<SimulatedRig>(drive, o.wiring);
    found = identify(*bench.rig, limits(o, sheet.drive()), hooks(o));
    bench.rig.reset();  // outputs off
  } catch (const RunFailed& failed) {
    std::cerr << (isatty(STDERR_FILENO) != 0 ? "\r\033[K" : "") << o.drive << ": " << failed.what()
              << "\n";
    if (bench.bridge) std::cerr << "link: " << bench.bridge->account() << "\n";
    return 1;
  }
  if (!o.json && isatty(STDERR_FILENO) != 0) fmt::print(stderr, "\r\033[K");
  const std::string title =
      fmt::format("{}: identified on {}, compared with {}\n", drive.drive().name, bench.name,
                  o.sheet.empty() ? "the [machine] table of the same file" : o.sheet);
  write_results(o, directory, sheet, found, title);
  return 0;
}

}  // namespace

void add_identify_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<IdentifyOptions>();
  CLI::App* verb =
      app.add_subcommand("identify", "Identify an unknown motor: experiments to a drive file");
  verb->add_option("DRIVE", o->drive, "read this drive file or preset")->required();
  verb->add_option("--out", o->out, "write identified.toml, identify.json, identify.txt here")
      ->required();
  verb->add_option("--on", o->on, "run the experiments on this plant")
      ->check(CLI::IsMember({"simulated", "bridge"}));
  verb->add_option("--port", o->port,
                   "with --on bridge: use this line, a serial device or udp://HOST:PORT");
  verb->add_option("--pace", o->pace,
                   "with --on bridge: choose the pace (default: lockstep where the drive waits for "
                   "each command, as an emulated one, else realtime)")
      ->check(CLI::IsMember({"auto", "lockstep", "realtime"}));
  verb->add_option("--sheet", o->sheet,
                   "take ratings and data-sheet values from this drive file, not from DRIVE");
  verb->add_option("--current", o->current, "limit the test current, A (default: rated)")
      ->check(above_zero());
  verb->add_option("--max-speed", o->speed_rpm, "limit the speed, rpm (default: rated)")
      ->check(above_zero());
  verb->add_flag("--swap-phases", o->wiring.swapped_phases, "simulate swapped phases b and c");
  verb->add_flag("--reverse-encoder", o->wiring.reversed_encoder,
                 "simulate an encoder that counts backwards");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_flag("--force", o->force, "replace an earlier result in --out");
  verb->add_flag("--json", o->json, "print JSON lines");
  verb->callback([o, &exit_code] { exit_code = run(*o); });
}

}  // namespace twinrate

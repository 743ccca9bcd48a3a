// twinrate simulate: the loop in one process, the same log as `launch --pace lockstep`, bit for
// bit.
#include <fmt/format.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "logger/tick_log.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "monitor/live_monitor.hpp"
#include "run/progress.hpp"
#include "run/run_result.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

struct SimulateOptions {
  std::string drive, run_dir;
  std::vector<std::string> overrides;
  std::string duration;
  bool json = false, monitor = false;
};

// Encodes each message as the bus would and hands it to the log.
class SimulatedBus {
 public:
  SimulatedBus(TickLog& log, std::int64_t session) : log_(log), session_(session) {}
  template <class Signal>
  void publish(const Signal& signal) {
    send(to_wire(signal, session_));
  }
  void publish_event(Reason reason, const std::string& text, std::int64_t k, std::int64_t t_ns,
                     Role role = Role::kController) {
    send(
        make_event({.role = role, .reason = reason, .k = k, .t_ns = t_ns, .text = text}, session_));
  }

 private:
  template <class Wire>
  void send(const Wire& wire) {
    const int size = wire.getEncodedSize();
    bytes_.resize(static_cast<std::size_t>(size));
    wire.encode(bytes_.data(), 0, size);
    log_.take(kChannelOf<Wire>, wire.seq, wire.t_ns, bytes_.data(), bytes_.size());
  }
  TickLog& log_;
  std::int64_t session_;
  std::vector<std::uint8_t> bytes_;
};

void publish_tick(SimulatedBus& bus, const TickRecord& tick) {
  bus.publish(tick.measurement);
  bus.publish(tick.truth);
  bus.publish(tick.estimate);
  if (tick.has_gain) bus.publish(tick.gain);
  bus.publish(tick.reference);
  bus.publish(tick.command);
  if (tick.event.reason != Reason::kNone)
    bus.publish_event(tick.event.reason, tick.event.text, tick.command.k, tick.command.t_ns);
}

// The monitor in this process: tracing takes no drive time here.
class OwnMonitor {
 public:
  OwnMonitor(Config& config, SimulatedBus& bus, ClosedLoop& loop, std::string directory)
      : config_(config),
        bus_(bus),
        loop_(loop),
        directory_(std::move(directory)),
        monitor_(config) {}
  // False where the disk is full.
  bool write() const {
    std::ofstream file(directory_ + "/monitor.json");
    file << monitor_.to_json();
    return static_cast<bool>(file.flush());
  }

  void take(const TickRecord& tick) {
    monitor_.take(tick.measurement);
    monitor_.take(tick.estimate);
    while (const auto job = monitor_.take_job()) monitor_.traced(run(*job));
    if (const auto toml = monitor_.take_addition()) {
      coming_ = (extended_ ? *extended_ : config_).with_effects(*toml, "monitor");
      from_k_ = monitor_.tick_for_addition();
    }
    for (const MonitorNotice& notice : monitor_.take_notices())
      bus_.publish_event(notice.reason, notice.text, notice.k, tick.measurement.t_ns,
                         Role::kMonitor);
    if (coming_ && loop_.k() >= from_k_) {
      loop_.know(*coming_);
      extended_ = std::exchange(coming_, {});
      monitor_.added(loop_.k());
    }
  }

 private:
  Config& config_;
  SimulatedBus& bus_;
  ClosedLoop& loop_;
  std::string directory_;
  LiveMonitor monitor_;
  std::optional<Config> extended_, coming_;
  std::int64_t from_k_ = 0;
};

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// Runs to the end or to Ctrl-C; returns what stopped it early, empty where nothing did.
std::string run_loop(Config& config, const std::string& directory, bool json) {
  const DriveConfig& d = config.drive();
  const std::int64_t session = new_session_id();
  const std::int64_t t0_us = wall_us();
  LogWriter writer(directory,
                   static_cast<std::int64_t>(config.read<BusParameters>().log_rotate_MB * 1e6));
  writer.set_manifest(
      info(Channel::kManifest).name,
      encode(make_manifest(session, config.resolved(), describe_host_json(session, d.run.seed))),
      t0_us);
  TickLog log(writer, TickLog::Order::kByTick, d, "", t0_us);
  SimulatedBus bus(log, session);
  ClosedLoop loop(config);
  std::optional<OwnMonitor> monitor;
  if (config.read<MonitorParameters>().enabled) monitor.emplace(config, bus, loop, directory);
  Progress progress(d, json);
  std::string ended;
  while (loop.k() < d.steps() && ended.empty()) {
    const TickRecord& tick = loop.step();
    publish_tick(bus, tick);
    if (monitor) monitor->take(tick);
    progress.show(tick.truth, tick.estimate, {});
    if (writer.full()) ended = writer.files().back() + ": the disk is full";
    if (stop_signalled()) ended = "interrupted";
  }
  progress.end();
  if (const std::string learnt = loop.controller().learnt(); !learnt.empty())
    bus.publish_event(Reason::kLearnt, learnt, loop.k() - 1, d.t_ns(loop.k() - 1));
  log.close();
  if (!writer.flush() && ended.empty()) ended = writer.files().back() + ": the disk is full";
  if (monitor && !monitor->write() && ended.empty())
    ended = directory + "/monitor.json: the disk is full";
  return ended;
}

int simulate(const SimulateOptions& o) {
  std::vector<std::string> overrides = o.overrides;
  if (!o.duration.empty()) overrides.push_back("run.duration_s=" + seconds_text(o.duration));
  if (o.monitor) overrides.push_back("monitor.enabled=true");
  Config config = load_drive(o.drive, overrides);
  const std::string directory = make_run_directory(o.run_dir, config);
  catch_stop_signals();
  const auto begun = Clock::now();
  RunFacts facts;
  facts.how = "simulate, one process";
  facts.ended = run_loop(config, directory, o.json);
  facts.wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  if (!facts.ended.empty()) fmt::print(stderr, "twinrate: {}\n", facts.ended);
  return conclude_run(directory, config, facts);
}

}  // namespace

void add_simulate_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<SimulateOptions>();
  CLI::App* verb =
      app.add_subcommand("simulate", "Run the whole loop in one process, without a bus");
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--duration", o->duration, "set the drive time, e.g. 2s or 500ms");
  verb->add_option("--run-dir", o->run_dir,
                   "write the run into this directory (default runs/NAME-DATE)");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_flag("--monitor", o->monitor,
                 "watch the run, trace and propose effects (as monitor.enabled = true)");
  verb->add_flag("--json", o->json, "print progress as JSON lines");
  verb->callback([o, &exit_code] { exit_code = simulate(*o); });
}

}  // namespace twinrate

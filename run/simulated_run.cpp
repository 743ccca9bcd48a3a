#include "run/simulated_run.hpp"

#include <fmt/format.h>

#include <chrono>
#include <optional>
#include <utility>
#include <vector>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "core/steering.hpp"
#include "logger/tick_log.hpp"
#include "monitor/live_monitor.hpp"
#include "run/progress.hpp"

namespace twinrate {
namespace {

// Encodes each message as on the bus and writes it to the log.
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
  if (tick.gain_every_nth)
    bus.publish_event(Reason::kGainEveryNth, kAgreedText, tick.estimate.k, tick.estimate.t_ns,
                      Role::kEstimator);
  if (tick.event.reason != Reason::kNone)
    bus.publish_event(tick.event.reason, tick.event.text, tick.command.k, tick.command.t_ns);
  for (const PlantEvent& event : tick.plant_events)
    bus.publish_event(event.reason, event.text, tick.command.k, tick.command.t_ns, Role::kPlant);
}

// The monitor in this process. Tracing takes no drive time.
class OwnMonitor {
 public:
  OwnMonitor(Config& config, SimulatedBus& bus, ClosedLoop& loop, std::string directory)
      : config_(config),
        bus_(bus),
        loop_(loop),
        directory_(std::move(directory)),
        monitor_(config) {}
  // False if the disk is full.
  bool write() const {
    try {
      write_new(directory_ + "/monitor.json", monitor_.to_json());
    } catch (const std::runtime_error&) {
      return false;
    }
    return true;
  }

  void take(const TickRecord& tick) {
    monitor_.take(tick.measurement);
    monitor_.take(tick.estimate);
    while (const auto job = monitor_.take_job()) monitor_.traced(run(*job));
    if (const auto toml = monitor_.take_addition())
      come(present().with_effects(*toml, "monitor"), true);
    if (const auto toml = monitor_.take_removal())
      come(present().without_effects(*toml, "monitor", config_.drive().effects.size()), false);
    for (const MonitorNotice& notice : monitor_.take_notices())
      bus_.publish_event(notice.reason, notice.text, notice.k, tick.measurement.t_ns,
                         Role::kMonitor);
    if (coming_ && loop_.k() >= from_k_) {
      loop_.know(*coming_);
      extended_ = std::exchange(coming_, {});
      if (adding_)
        monitor_.added(loop_.k());
      else
        monitor_.removed(loop_.k());
    }
  }

 private:
  const Config& present() const { return extended_ ? *extended_ : config_; }
  void come(Config changed, bool adding) {
    coming_ = std::move(changed);
    adding_ = adding;
    from_k_ = monitor_.tick_for_request();
  }

  Config& config_;
  SimulatedBus& bus_;
  ClosedLoop& loop_;
  std::string directory_;
  LiveMonitor monitor_;
  std::optional<Config> extended_, coming_;
  bool adding_ = true;
  std::int64_t from_k_ = 0;
};

std::string disk_full(const LogWriter& writer) {
  return fmt::format("{}; the log holds {} whole ticks", writer.failure(), writer.marked_on_disk());
}

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

std::string run_simulated(Config& config, const std::string& directory, bool json,
                          const MakeFilter& make) {
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
  log.follow(rate_history(config));
  SimulatedBus bus(log, session);
  ClosedLoop loop(config, make);
  std::optional<OwnMonitor> monitor;
  if (config.read<MonitorParameters>().enabled) monitor.emplace(config, bus, loop, directory);
  Progress progress(d, json);
  std::string ended;
  while (loop.k() < d.steps() && ended.empty()) {
    const TickRecord& tick = loop.step();
    publish_tick(bus, tick);
    if (monitor) monitor->take(tick);
    progress.show(tick.truth, tick.estimate, {});
    if (writer.full()) ended = disk_full(writer);
    if (stop_signalled()) ended = "interrupted";
  }
  progress.end();
  if (const std::string learnt = loop.controller().learnt(); !learnt.empty())
    bus.publish_event(Reason::kLearnt, learnt, loop.k() - 1, d.t_ns(loop.k() - 1));
  log.close();
  if (!writer.flush() && ended.empty()) ended = disk_full(writer);
  if (monitor && !monitor->write() && ended.empty())
    ended = directory + "/monitor.json: the disk is full";
  return ended;
}

}  // namespace twinrate

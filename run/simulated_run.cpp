#include "run/simulated_run.hpp"

#include <fmt/format.h>
#include <sys/mman.h>

#include <array>
#include <cassert>
#include <chrono>
#include <deque>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/encode_tick.hpp"
#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "logger/log_writer.hpp"
#include "monitor/monitor_parameters.hpp"
#include "run/progress.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kGatheredBytes = 1 << 20;  // a write of the log

// Encodes each message as on the bus and writes it to the log, in the order of a lock-step run.
class SimulatedBus {
 public:
  // `kept`: the ticks in memory as well; may be null.
  SimulatedBus(LogWriter& writer, std::int64_t session, std::int64_t t0_us, LongLog* kept)
      : writer_(writer), session_(session), t0_us_(t0_us), kept_(kept) {
    for (const ChannelInfo& channel : kChannels)
      names_[static_cast<std::size_t>(channel.channel)] = channel.name;
  }
  void publish_tick(const TickRecord& tick) {
    t_ns_ = tick.measurement.t_ns;
    to_wire(tick.estimate, session_, estimate_);
    publish(to_wire(tick.measurement, session_));
    publish(to_wire(tick.truth, session_));
    publish(estimate_);
    if (tick.has_gain) {
      to_wire(tick.gain, session_, gain_);
      publish(gain_);
    }
    publish(to_wire(tick.reference, session_));
    publish(to_wire(tick.command, session_));
    if (kept_) keep(tick);
    writer_.mark(tick.measurement.k + 1);
    if (tick.gain_every_nth)
      publish_event(Reason::kGainEveryNth, kAgreedText, tick.estimate.k, tick.estimate.t_ns,
                    Role::kEstimator);
    if (tick.event.reason != Reason::kNone)
      publish_event(tick.event.reason, tick.event.text, tick.command.k, tick.command.t_ns);
    for (const PlantEvent& event : tick.plant_events)
      publish_event(event.reason, event.text, tick.command.k, tick.command.t_ns, Role::kPlant);
  }
  void publish_event(Reason reason, const std::string& text, std::int64_t k, std::int64_t t_ns,
                     Role role = Role::kController) {
    const event_t wire =
        make_event({.role = role, .reason = reason, .k = k, .t_ns = t_ns, .text = text}, session_);
    send(wire, Channel::kEvent,
         [&](std::uint8_t* to, std::size_t size) { wire.encode(to, 0, static_cast<int>(size)); });
    if (kept_) kept_->log.events.push_back(from_wire(wire));
  }

 private:
  template <class Wire>
  void publish(Wire&& wire) {
    send(wire, kChannelOf<std::remove_reference_t<Wire>>,
         [&](std::uint8_t* to, std::size_t /*size*/) { encode_tick(wire, to); });
  }
  // Encodes into the log's own buffer. Time stamps of the log are those of the ticks.
  template <class Wire, class Encode>
  void send(const Wire& wire, Channel sent, const Encode& encode) {
    const auto channel = static_cast<std::size_t>(sent);
    const auto size = static_cast<std::size_t>(wire.getEncodedSize());
    if (std::uint8_t* const to = writer_.room_for(names_[channel], size, t0_us_ + t_ns_ / 1000))
      encode(to, size);
    if (kept_) ++kept_->log.counts[channel];
  }
  void keep(const TickRecord& tick) {
    TickRow& row = kept_->ticks.rows.emplace_back();
    row.k = tick.measurement.k;
    row.take(tick.measurement);
    row.take(tick.truth);
    row.take(tick.estimate);
    row.take(tick.command);
    if (tick.has_gain) gains_.emplace_back(tick.gain);
    // The gains come in the order of their use.
    while (!gains_.empty() && gains_.front().k < tick.estimate.gain_seq) gains_.pop_front();
    if (!gains_.empty() && gains_.front().k == tick.estimate.gain_seq) row.gain = gains_.front();
    RunOutline& outline = kept_->ticks.outline;
    outline.add(row);
    for (const Channel channel : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                                  Channel::kReference, Channel::kCommand})
      outline.add(channel, row.k);
    if (tick.has_gain) outline.add(Channel::kGain, tick.gain.k);
  }
  LogWriter& writer_;
  std::int64_t session_, t0_us_, t_ns_ = 0;
  LongLog* kept_;
  std::deque<TickRow::OfGain> gains_;  // from the one in use on
  std::array<std::string, kChannelCount> names_;
  estimate_t estimate_{};
  gain_t gain_{};
};

std::string disk_full(const LogWriter& writer) {
  return fmt::format("{}; the log holds {} whole ticks", writer.failure(), writer.marked_on_disk());
}

// A page fault for each 2 MB where the kernel has such pages, instead of one for each 4 kB.
template <class T>
void use_huge_pages(std::vector<T>& reserved) {
  constexpr std::size_t kPage = 2 << 20;
  auto* begin = reinterpret_cast<char*>(reserved.data());
  auto* end = reinterpret_cast<char*>(reserved.data() + reserved.capacity());
  begin += (kPage - reinterpret_cast<std::uintptr_t>(begin) % kPage) % kPage;
  if (end - begin >= static_cast<std::ptrdiff_t>(kPage))
    madvise(begin, static_cast<std::size_t>(end - begin) / kPage * kPage, MADV_HUGEPAGE);
}

void begin(LongLog& kept, const std::string& directory, const manifest_t& manifest,
           std::int64_t ticks) {
  kept.log.path = directory;
  kept.log.set(manifest);
  kept.ticks.rows.reserve(static_cast<std::size_t>(ticks));
  use_huge_pages(kept.ticks.rows);
}

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

std::string run_simulated(Config& config, const std::string& directory, bool json,
                          const MakeFilter& make, std::optional<LongLog>* kept,
                          MakeTickWatch make_monitor) {
  const DriveConfig& d = config.drive();
  const bool monitored = config.read<MonitorParameters>().enabled;
  assert(!monitored || make_monitor);
  const std::int64_t session = new_session_id();
  const std::int64_t t0_us = wall_us();
  LogWriter writer(directory,
                   static_cast<std::int64_t>(config.read<BusParameters>().log_rotate_MB * 1e6), 0,
                   kGatheredBytes);
  const manifest_t manifest =
      make_manifest(session, config.resolved(), describe_host_json(session, d.run.seed));
  writer.set_manifest(info(Channel::kManifest).name, encode(manifest), t0_us);
  LongLog* const in_memory = kept && d.steps() <= kTicksShown ? &kept->emplace() : nullptr;
  if (in_memory) begin(*in_memory, directory, manifest, d.steps());
  SimulatedBus bus(writer, session, t0_us, in_memory);
  ClosedLoop loop(config, make);
  std::unique_ptr<TickWatch> monitor;
  if (monitored)
    monitor = make_monitor(
        config, loop, directory,
        [&bus](Reason reason, const std::string& text, std::int64_t k, std::int64_t t_ns) {
          bus.publish_event(reason, text, k, t_ns, Role::kMonitor);
        });
  Progress progress(d, json);
  std::string ended;
  while (loop.k() < d.steps() && ended.empty()) {
    const TickRecord& tick = loop.step();
    bus.publish_tick(tick);
    if (monitor) monitor->take(tick);
    progress.show(tick.truth, tick.estimate, {});
    if (writer.full()) ended = disk_full(writer);
    if (stop_signalled()) ended = "interrupted";
  }
  progress.end();
  if (const std::string learnt = loop.controller().learnt(); !learnt.empty())
    bus.publish_event(Reason::kLearnt, learnt, loop.k() - 1, d.t_ns(loop.k() - 1));
  if (in_memory)
    in_memory->log.counts[static_cast<std::size_t>(Channel::kManifest)] =
        static_cast<std::int64_t>(writer.files().size());
  if (!writer.finish() && ended.empty()) ended = disk_full(writer);
  if (monitor && !monitor->write() && ended.empty())
    ended = directory + "/monitor.json: the disk is full";
  return ended;
}

}  // namespace twinrate

#include "core/run_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/reason.hpp"
#include "core/run_log_part.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

template <class Wire, class Item>
void take(const lcm::LogEvent& event, std::vector<Item>& messages) {
  Wire wire{};
  if (decode(wire, event.data, static_cast<std::size_t>(event.datalen)))
    messages.push_back(from_wire(wire));
}

// Before schema 4 no filter waited for its agreement: a replay computes as the log did.
std::string config_of(const manifest_t& manifest) {
  constexpr int kWithNFrom = 4;
  std::string text = manifest.config_toml;
  const std::string table = "[rates]\n";
  const auto at = text.find(table);
  if (manifest.schema >= kWithNFrom || at == std::string::npos) return text;
  return text.insert(at + table.size(), "n_from = \"start\"\n");
}

void take_manifest(const lcm::LogEvent& event, RunLog& log) {
  if (const auto manifest = decode_manifest(event.data, event.datalen, log.path))
    log.set(*manifest);
}

void take(Channel channel, const lcm::LogEvent& event, RunLog& log) {
  switch (channel) {
    case Channel::kManifest:
      return take_manifest(event, log);
    case Channel::kMeasurement:
      return take<measurement_t>(event, log.measurement);
    case Channel::kTruth:
      return take<truth_t>(event, log.truth);
    case Channel::kEstimate:
      return take<estimate_t>(event, log.estimate);
    case Channel::kGain:
      return take<gain_t>(event, log.gain);
    case Channel::kReference:
      return take<reference_t>(event, log.reference);
    case Channel::kCommand:
      return take<command_t>(event, log.command);
    case Channel::kEvent:
      return take<event_t>(event, log.events);
    default:
      return;
  }
}

// `seq` and `t_ns` of a message: after its fingerprint.
constexpr int kTickAt = 8, kTimeAt = 16;

std::int64_t number_at(const lcm::LogEvent& event, int at) {
  std::uint64_t number = 0;
  if (event.datalen < at + 8) return -1;
  for (int i = at; i < at + 8; ++i)
    number = number << 8 | static_cast<const std::uint8_t*>(event.data)[i];
  return static_cast<std::int64_t>(number);
}
std::int64_t tick_of(const lcm::LogEvent& event) {
  return number_at(event, kTickAt);
}

template <class Item>
void order_by_tick(std::vector<Item>& items) {
  const auto earlier = [](const Item& a, const Item& b) { return a.k < b.k; };
  if (!std::is_sorted(items.begin(), items.end(), earlier))
    std::stable_sort(items.begin(), items.end(), earlier);
}

}  // namespace

EventRecord from_wire(const event_t& w) {
  return {.k = w.seq,
          .t_ns = w.t_ns,
          .role = w.role,
          .reason = w.reason,
          .text = w.text,
          .waited_for = w.waited_for};
}

void RunLog::set(const manifest_t& manifest) {
  session = manifest.session;
  revision = manifest.revision;
  config_toml = config_of(manifest);
  manifest_json = manifest.manifest_json;
}

std::optional<manifest_t> decode_manifest(const void* bytes, int count, const std::string& path) {
  manifest_t manifest;
  if (!decode(manifest, bytes, static_cast<std::size_t>(count))) return {};
  if (manifest.schema < kOldestWireSchema || manifest.schema > kWireSchema)
    throw BadInput(
        fmt::format("{}: written with message types of version {}, this program reads {} to {}",
                    path, manifest.schema, kOldestWireSchema, kWireSchema));
  return manifest;
}

namespace {

// The supervisor knows the tick of the plant's last heartbeat only: its event is not before a
// MEASUREMENT that was logged before it.
class SupervisorTime {
 public:
  void note(Channel channel, const lcm::LogEvent& event) {
    if (channel != Channel::kMeasurement) return;
    k_ = std::max(k_, number_at(event, kTickAt));
    t_ns_ = std::max(t_ns_, number_at(event, kTimeAt));
  }
  void correct(EventRecord& event) const {
    if (event.role != static_cast<int>(Role::kSupervisor)) return;
    event.k = std::max(event.k, k_);
    event.t_ns = std::max(event.t_ns, t_ns_);
  }

 private:
  std::int64_t k_ = -1, t_ns_ = 0;
};

// Limits the events, but never hides a trip behind them.
void bound(std::vector<EventRecord>& events, std::size_t most) {
  if (events.size() <= most) return;
  const bool trip = is_trip(static_cast<Reason>(events.back().reason));
  if (!trip || events.size() / 2 >= most) events.pop_back();
}

// Reads the log; `take_tick` decides which messages of ticks are kept.
template <class TakeTick>
RunLog read_with(const std::string& path, const std::string& channel_suffix, OnDamage on_damage,
                 std::size_t most_events, TakeTick take_tick) {
  RunLog log;
  log.path = path;
  EventLog events(path, on_damage, channel_suffix);
  log.channel_suffix = events.suffix();
  SupervisorTime supervisor;
  while (const lcm::LogEvent* event = events.next()) {
    if (!events.channel()) continue;
    supervisor.note(*events.channel(), *event);
    if (*events.channel() < Channel::kStatus) {
      take_tick(*events.channel(), *event, log);
      continue;
    }
    const std::size_t known = log.events.size();
    take(*events.channel(), *event, log);
    if (log.events.size() > known) supervisor.correct(log.events.back());
    bound(log.events, most_events);
  }
  log.counts = events.counts();
  log.counted = events.counted();
  log.damage = events.damage();
  const auto heard = [&](Channel channel) {
    return log.counts[static_cast<std::size_t>(channel)] > 0;
  };
  if (!heard(Channel::kMeasurement) && !heard(Channel::kEstimate) && !heard(Channel::kCommand))
    throw BadInput(fmt::format("{}: holds no message of this project (channels DRIVE_..{})", path,
                               log.channel_suffix));
  order_by_tick(log.measurement);
  order_by_tick(log.truth);
  order_by_tick(log.estimate);
  order_by_tick(log.gain);
  order_by_tick(log.reference);
  order_by_tick(log.command);
  return log;
}

}  // namespace

RunLog read_run_log(const std::string& path, const std::string& channel_suffix,
                    OnDamage on_damage) {
  return read_with(
      path, channel_suffix, on_damage, std::numeric_limits<std::size_t>::max(),
      [](Channel channel, const lcm::LogEvent& event, RunLog& log) { take(channel, event, log); });
}

RunLog scan_run_log(const std::string& path, const std::string& channel_suffix, OnDamage on_damage,
                    const std::function<void(Channel, const lcm::LogEvent&)>& take_tick) {
  return read_with(
      path, channel_suffix, on_damage, kEventsKept,
      [&](Channel channel, const lcm::LogEvent& event, RunLog&) { take_tick(channel, event); });
}

RunLog read_run_log_part(const std::string& path, const std::string& channel_suffix,
                         OnDamage on_damage, std::int64_t first, std::int64_t last, int n) {
  return read_with(path, channel_suffix, on_damage, kEventsKept,
                   [=](Channel channel, const lcm::LogEvent& event, RunLog& log) {
                     const std::int64_t k = tick_of(event);
                     const std::int64_t from = channel == Channel::kGain ? first - 4 * n : first;
                     if (k >= from && k <= last) take(channel, event, log);
                   });
}

}  // namespace twinrate

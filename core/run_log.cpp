#include "core/run_log.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

EventRecord from_wire(const event_t& w) {
  return {.k = w.seq,
          .t_ns = w.t_ns,
          .role = w.role,
          .reason = w.reason,
          .text = w.text,
          .waited_for = w.waited_for};
}

template <class Wire, class Item>
void take(const lcm::LogEvent& event, std::vector<Item>& messages) {
  Wire wire{};
  if (decode(wire, event.data, static_cast<std::size_t>(event.datalen)))
    messages.push_back(from_wire(wire));
}

// Before schema 4 no filter waited for its agreement: a replay computes what the log holds.
std::string config_of(const manifest_t& manifest) {
  constexpr int kWithNFrom = 4;
  std::string text = manifest.config_toml;
  const std::string table = "[rates]\n";
  const auto at = text.find(table);
  if (manifest.schema >= kWithNFrom || at == std::string::npos) return text;
  return text.insert(at + table.size(), "n_from = \"start\"\n");
}

void take_manifest(const lcm::LogEvent& event, RunLog& log) {
  const auto manifest = decode_manifest(event.data, event.datalen, log.path);
  if (!manifest) return;
  log.session = manifest->session;
  log.revision = manifest->revision;
  log.config_toml = config_of(*manifest);
  log.manifest_json = manifest->manifest_json;
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

template <class Item>
void order_by_tick(std::vector<Item>& items) {
  const auto earlier = [](const Item& a, const Item& b) { return a.k < b.k; };
  if (!std::is_sorted(items.begin(), items.end(), earlier))
    std::stable_sort(items.begin(), items.end(), earlier);
}

}  // namespace

std::optional<manifest_t> decode_manifest(const void* bytes, int count, const std::string& path) {
  manifest_t manifest;
  if (manifest.decode(bytes, 0, count) < 0) return {};
  if (manifest.schema < kOldestWireSchema || manifest.schema > kWireSchema)
    throw BadInput(
        fmt::format("{}: written with message types of version {}, this program reads {} to {}",
                    path, manifest.schema, kOldestWireSchema, kWireSchema));
  return manifest;
}

RunLog read_run_log(const std::string& path, const std::string& channel_suffix,
                    OnDamage on_damage) {
  RunLog log;
  log.path = path;
  EventLog events(path, on_damage, channel_suffix);
  log.channel_suffix = events.suffix();
  while (const lcm::LogEvent* event = events.next())
    if (events.channel()) take(*events.channel(), *event, log);
  log.counts = events.counts();
  log.counted = events.counted();
  log.damage = events.damage();
  if (log.measurement.empty() && log.estimate.empty() && log.command.empty())
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

}  // namespace twinrate

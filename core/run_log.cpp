#include "core/run_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <lcm/lcm-cpp.hpp>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

EventRecord from_wire(const event_t& w) {
  return {.k = w.seq,
          .t_ns = w.t_ns,
          .role = w.role,
          .reason = w.reason,
          .text = w.text,
          .waited_for = w.waited_for};
}

// Decodes one event into `messages` when it is on that channel.
template <class Wire, class Item>
bool take(const lcm::LogEvent& event, const std::string& suffix, std::vector<Item>& messages,
          RunLog& log) {
  if (event.channel != info(kChannelOf<Wire>).name + suffix) return false;
  Wire wire{};
  if (!decode(wire, event.data, static_cast<std::size_t>(event.datalen)))
    ++log.undecodable;
  else
    messages.push_back(from_wire(wire));
  return true;
}

void take_manifest(const lcm::LogEvent& event, RunLog& log) {
  const auto manifest = decode_manifest(event.data, event.datalen, log.path);
  if (!manifest) {
    ++log.undecodable;
    return;
  }
  log.session = manifest->session;
  log.revision = manifest->revision;
  log.config_toml = manifest->config_toml;
  log.manifest_json = manifest->manifest_json;
}

void read_part(const std::string& part, const std::string& suffix, RunLog& log) {
  lcm::LogFile file(part, "r");
  if (!file.good()) throw BadInput(fmt::format("{}: cannot be read", part));
  const std::string manifest_channel = info(Channel::kManifest).name + suffix;
  while (const lcm::LogEvent* event = file.readNextEvent()) {
    if (event->channel == manifest_channel)
      take_manifest(*event, log);
    else
      take<measurement_t>(*event, suffix, log.measurement, log) ||
          take<truth_t>(*event, suffix, log.truth, log) ||
          take<estimate_t>(*event, suffix, log.estimate, log) ||
          take<gain_t>(*event, suffix, log.gain, log) ||
          take<reference_t>(*event, suffix, log.reference, log) ||
          take<command_t>(*event, suffix, log.command, log) ||
          take<event_t>(*event, suffix, log.events, log);
  }
}

template <class Item>
void order_by_tick(std::vector<Item>& items) {
  const auto earlier = [](const Item& a, const Item& b) { return a.k < b.k; };
  if (!std::is_sorted(items.begin(), items.end(), earlier))
    std::stable_sort(items.begin(), items.end(), earlier);
}

}  // namespace

std::vector<std::string> log_parts(const std::string& path) {
  if (!fs::is_directory(path)) {
    if (!fs::is_regular_file(path)) throw BadInput(fmt::format("{}: no such log", path));
    return {path};
  }
  std::vector<std::string> parts;
  const fs::path first = fs::path(path) / "log.lcm";
  if (!fs::is_regular_file(first))
    throw BadInput(fmt::format("{}: no log.lcm in this directory", path));
  parts.push_back(first.string());
  for (int part = 1;; ++part) {
    const fs::path next = fs::path(path) / fmt::format("log-{:03}.lcm", part);
    if (!fs::is_regular_file(next)) break;
    parts.push_back(next.string());
  }
  return parts;
}

std::string channel_suffix_of(const std::string& part) {
  lcm::LogFile file(part, "r");
  const lcm::LogEvent* event = file.good() ? file.readNextEvent() : nullptr;
  const std::string name = info(Channel::kManifest).name;
  return event && event->channel.rfind(name, 0) == 0 ? event->channel.substr(name.size()) : "";
}

std::optional<manifest_t> decode_manifest(const void* bytes, int count, const std::string& path) {
  manifest_t manifest;
  if (manifest.decode(bytes, 0, count) < 0) return {};
  if (manifest.schema < kOldestWireSchema || manifest.schema > kWireSchema)
    throw BadInput(
        fmt::format("{}: written with message types of version {}, this program reads {} to {}",
                    path, manifest.schema, kOldestWireSchema, kWireSchema));
  return manifest;
}

RunLog read_run_log(const std::string& path, const std::string& channel_suffix) {
  RunLog log;
  log.path = path;
  const std::vector<std::string> parts = log_parts(path);
  log.channel_suffix = channel_suffix.empty() ? channel_suffix_of(parts.front()) : channel_suffix;
  for (const std::string& part : parts) read_part(part, log.channel_suffix, log);
  if (log.undecodable > 0)
    throw BadInput(fmt::format("{}: {} messages have another type version than this program", path,
                               log.undecodable));
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

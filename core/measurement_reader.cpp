#include "core/measurement_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/manifest.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kAhead = 64;  // measurements by which one may come late

}  // namespace

MeasurementReader::MeasurementReader(const std::string& path, OnDamage on_damage)
    : path_(path), on_damage_(on_damage), log_(path, on_damage) {}

void MeasurementReader::take(const lcm::LogEvent& event) {
  found_message_ = found_message_ || event.channel.starts_with("DRIVE_");
  if (log_.channel() == Channel::kManifest) {
    if (const auto manifest = decode_manifest(event.data, event.datalen, path_)) {
      config_toml_ = manifest->config_toml;
      imported_ = imported_signals(manifest->manifest_json).has_value();
    }
    return;
  }
  if (log_.channel() == Channel::kEvent) return take_steering(event);
  if (log_.channel() != Channel::kMeasurement) return;
  measurement_t wire{};
  if (!decode(wire, event.data, static_cast<std::size_t>(event.datalen))) return;
  const auto later = std::upper_bound(ahead_.begin(), ahead_.end(), wire.seq,
                                      [](std::int64_t k, const Entry& e) { return k < e.m.k; });
  const std::int64_t before = later == ahead_.begin() ? last_k_ : std::prev(later)->m.k;
  if (on_damage_ == OnDamage::kSkip && wire.seq <= before) return;  // known, or too late
  ahead_.insert(later, {from_wire(wire), log_.place()});
}

void MeasurementReader::take_steering(const lcm::LogEvent& event) {
  const Place place = log_.place();
  event_t wire{};
  if (std::pair(place.part, place.byte) <=
          std::pair(steering_read_to_.part, steering_read_to_.byte) ||
      !decode(wire, event.data, static_cast<std::size_t>(event.datalen)) ||
      wire.reason != static_cast<int>(Reason::kSteered))
    return;
  steering_read_to_ = place;
  steering_.push_back({wire.seq, wire.text});
}

void MeasurementReader::fill() {
  while (ahead_.size() < kAhead) {
    const lcm::LogEvent* event = log_.next();
    if (!event) break;
    take(*event);
  }
  if (ahead_.empty() && !found_message_)
    throw BadInput(fmt::format("{}: holds no message of this project (channels DRIVE_..{})", path_,
                               log_.suffix()));
}

const Measurement* MeasurementReader::peek() {
  fill();
  return ahead_.empty() ? nullptr : &ahead_.front().m;
}

bool MeasurementReader::next(Measurement& m) {
  fill();
  if (ahead_.empty()) return false;
  m = ahead_.front().m;
  last_k_ = m.k;
  ahead_.pop_front();
  return true;
}

MeasurementReader::Place MeasurementReader::place() {
  fill();
  return ahead_.empty() ? log_.place() : ahead_.front().place;
}

void MeasurementReader::go_to(const Place& place) {
  ahead_.clear();
  last_k_ = -1;
  log_.go_to(place);
}

}  // namespace twinrate

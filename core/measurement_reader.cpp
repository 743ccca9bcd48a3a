#include "core/measurement_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/manifest.hpp"
#include "core/run_log.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kAhead = 64;  // measurements by which one may come late

}  // namespace

MeasurementReader::MeasurementReader(const std::string& path)
    : path_(path), parts_(log_parts(path)) {
  suffix_ = channel_suffix_of(parts_.front());
  channel_ = info(Channel::kMeasurement).name + suffix_;
  manifest_channel_ = info(Channel::kManifest).name + suffix_;
  bytes_before_ = {0};
  for (const std::string& part : parts_)
    bytes_before_.push_back(bytes_before_.back() +
                            static_cast<std::int64_t>(std::filesystem::file_size(part)));
  open(0, 0);
}

void MeasurementReader::open(std::size_t part, std::int64_t byte) {
  if (!file_ || part != part_) {
    file_ = std::make_unique<lcm::LogFile>(parts_[part], "r");
    if (!file_->good()) throw BadInput(fmt::format("{}: cannot be read", parts_[part]));
    part_ = part;
  }
  fseeko(file_->getFilePtr(), byte, SEEK_SET);
}

void MeasurementReader::take(const lcm::LogEvent& event, const Place& place) {
  found_message_ = found_message_ || event.channel.starts_with("DRIVE_");
  if (event.channel == manifest_channel_) {
    if (const auto manifest = decode_manifest(event.data, event.datalen, path_)) {
      config_toml_ = manifest->config_toml;
      imported_ = imported_signals(manifest->manifest_json).has_value();
    }
    return;
  }
  if (event.channel != channel_) return;
  measurement_t wire{};
  if (!decode(wire, event.data, static_cast<std::size_t>(event.datalen)))
    throw BadInput(fmt::format("{}: messages have another type version than this program", path_));
  const auto later = std::upper_bound(ahead_.begin(), ahead_.end(), wire.seq,
                                      [](std::int64_t k, const Entry& e) { return k < e.m.k; });
  ahead_.insert(later, {from_wire(wire), place});
}

void MeasurementReader::fill() {
  while (ahead_.size() < kAhead) {
    const Place place{part_, ftello(file_->getFilePtr())};
    if (const lcm::LogEvent* event = file_->readNextEvent()) {
      take(*event, place);
    } else if (part_ + 1 < parts_.size()) {
      open(part_ + 1, 0);
    } else {
      break;
    }
  }
  if (ahead_.empty() && !found_message_)
    throw BadInput(
        fmt::format("{}: holds no message of this project (channels DRIVE_..{})", path_, suffix_));
}

const Measurement* MeasurementReader::peek() {
  fill();
  return ahead_.empty() ? nullptr : &ahead_.front().m;
}

bool MeasurementReader::next(Measurement& m) {
  fill();
  if (ahead_.empty()) return false;
  m = ahead_.front().m;
  ahead_.pop_front();
  return true;
}

double MeasurementReader::share_read() const {
  const auto read = bytes_before_[part_] + ftello(file_->getFilePtr());
  return static_cast<double>(read) /
         static_cast<double>(std::max<std::int64_t>(1, bytes_before_.back()));
}

MeasurementReader::Place MeasurementReader::place() {
  fill();
  return ahead_.empty() ? Place{part_, ftello(file_->getFilePtr())} : ahead_.front().place;
}

void MeasurementReader::go_to(const Place& place) {
  ahead_.clear();
  open(place.part, place.byte);
}

}  // namespace twinrate

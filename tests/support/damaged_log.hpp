// A small log of a drive, and damage to it that a reader must find.
#pragma once
#include <cstdint>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/config.hpp"
#include "core/log_marks.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"

namespace twinrate::test {

struct RawEvent {
  std::int64_t number = 0, timestamp = 0;
  std::string channel;
  std::vector<std::uint8_t> bytes;
  std::int32_t channel_length = 0, data_length = 0;  // as the file says
};

template <class Wire>
RawEvent raw_event(const Wire& wire, std::int64_t timestamp) {
  RawEvent e;
  e.timestamp = timestamp;
  e.channel = info(kChannelOf<Wire>).name;
  e.bytes.resize(static_cast<std::size_t>(wire.getEncodedSize()));
  wire.encode(e.bytes.data(), 0, static_cast<int>(e.bytes.size()));
  e.channel_length = static_cast<std::int32_t>(e.channel.size());
  e.data_length = static_cast<std::int32_t>(e.bytes.size());
  return e;
}

inline void number(std::vector<RawEvent>& events) {
  for (std::size_t i = 0; i < events.size(); ++i) events[i].number = static_cast<std::int64_t>(i);
}

inline RawEvent mark(std::string_view text, std::int64_t timestamp) {
  return {.timestamp = timestamp,
          .channel = std::string(kLogMarkChannel),
          .bytes = {text.begin(), text.end()},
          .channel_length = static_cast<std::int32_t>(kLogMarkChannel.size()),
          .data_length = static_cast<std::int32_t>(text.size())};
}

// A manifest, then MEASUREMENT, ESTIMATE, REFERENCE, COMMAND of each tick, and events; with the marks
// of a writer.
inline std::vector<RawEvent> small_log(const Config& config, std::int64_t ticks) {
  std::vector<RawEvent> events = {raw_event(make_manifest(1, config.resolved(), "{}"), 1'000'000),
                                  mark(kLogBegins, 1'000'000)};
  for (std::int64_t k = 0; k < ticks; ++k) {
    const std::int64_t t_ns = config.drive().t_ns(k), t_us = 1'000'000 + t_ns / 1000;
    events.push_back(raw_event(to_wire(Measurement{.k = k, .t_ns = t_ns, .signals = 15}, 1), t_us));
    events.push_back(
        raw_event(to_wire(Estimate{.k = k, .t_ns = t_ns, .n_x = 4, .n_y = 2}, 1), t_us));
    events.push_back(raw_event(to_wire(Reference{.k = k, .t_ns = t_ns}, 1), t_us));
    events.push_back(raw_event(to_wire(Command{.k = k, .t_ns = t_ns}, 1), t_us));
    event_t event{};
    event.seq = k;
    event.waited_for = -1;
    event.text = "a text";
    if (k % 10 == 0) events.push_back(raw_event(event, t_us));
  }
  events.push_back(mark(kLogEnds, events.back().timestamp));
  number(events);
  return events;
}

inline std::string file_of(const std::vector<RawEvent>& events) {
  std::string file;
  const auto put = [&](std::uint64_t value, int count) {
    for (int i = count - 1; i >= 0; --i) file += static_cast<char>(value >> (8 * i) & 0xff);
  };
  for (const RawEvent& e : events) {
    put(0xEDA1DA01, 4);
    put(static_cast<std::uint64_t>(e.number), 8);
    put(static_cast<std::uint64_t>(e.timestamp), 8);
    put(static_cast<std::uint32_t>(e.channel_length), 4);
    put(static_cast<std::uint32_t>(e.data_length), 4);
    file += e.channel;
    file.append(e.bytes.begin(), e.bytes.end());
  }
  return file;
}

class Damage {
 public:
  Damage(std::vector<RawEvent> whole, std::uint64_t seed)
      : whole_(std::move(whole)), random_(seed) {}

  static constexpr int kKinds = 15;
  // The file after damage of this kind at a random place.
  std::string apply(int kind) {
    std::vector<RawEvent> events = whole_;
    if (kind == 0) return cut(file_of(events));
    if (kind == 1) return overwritten(file_of(events));
    damage(kind, events);
    return file_of(events);
  }

 private:
  std::size_t below(std::size_t end, std::size_t begin = 0) {
    return std::uniform_int_distribution<std::size_t>(begin, end - 1)(random_);
  }
  std::int32_t bad_length(std::int32_t right) {
    const std::int32_t bad[] = {INT32_MAX, INT32_MIN, -1, 0, right + 1, right - 1, 1 << 24};
    return bad[below(std::size(bad))];
  }
  // Every other one at the end of an event.
  std::string cut(const std::string& file) {
    const std::size_t at = below(file.size(), 1);
    const std::size_t event = file.rfind("\xED\xA1\xDA\x01", at);
    return file.substr(0, below(2) == 0 && event > 0 ? event : at);
  }
  // 64 bytes of noise: more than a channel name, at least a part of a header.
  std::string overwritten(std::string file) {
    const std::size_t sync = file.find("\xED\xA1\xDA\x01", below(file.size() - 8000));
    for (std::size_t i = sync; i < sync + 64; ++i) file[i] = static_cast<char>(below(256));
    return file;
  }
  RawEvent& with_text(std::vector<RawEvent>& events) {
    for (;;)
      if (RawEvent& e = events[below(events.size())]; e.channel == "DRIVE_EVENT") return e;
  }
  static void put(RawEvent& e, std::size_t at, std::int64_t value, int count) {
    for (int i = 0; i < count; ++i)
      e.bytes[at + static_cast<std::size_t>(i)] =
          static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * (count - 1 - i)));
  }
  void damage(int kind, std::vector<RawEvent>& events) {
    const std::size_t at = below(events.size() - 4, 1);
    RawEvent& e = events[at];
    const auto place = events.begin() + static_cast<std::ptrdiff_t>(at);
    switch (kind) {
      case 2:
        e.channel_length = bad_length(e.channel_length);
        break;
      case 3:
        e.data_length = bad_length(e.data_length);
        break;
      case 4:  // written again by a program that numbers the events anew
        std::shuffle(events.begin() + 1, events.end(), random_);
        number(events);
        break;
      case 5:
        std::reverse(events.begin() + 1, events.end());
        number(events);
        break;
      case 6:
        events.erase(place);
        break;
      case 7:
        events.insert(place, events[at]);
        break;
      case 8:  // the message of another channel
        e.bytes = events[at + 1].bytes;
        e.data_length = events[at + 1].data_length;
        break;
      case 9: {
        RawEvent& text = with_text(events);
        const std::int32_t lengths[] = {0, -1, INT32_MIN, INT32_MAX, 6, 8};
        put(text, 44, lengths[below(6)], 4);
        break;
      }
      case 10: {
        RawEvent& text = with_text(events);
        text.bytes[48 + below(6)] = static_cast<std::uint8_t>(0x80 + below(0x40));  // no UTF-8
        break;
      }
      case 11:
        e.number = static_cast<std::int64_t>(random_());
        break;
      case 12:
        e.timestamp = static_cast<std::int64_t>(random_());
        break;
      case 13:  // the size of a state
        for (std::size_t i = at;; ++i)
          if (events[i].channel == "DRIVE_ESTIMATE" || i + 1 == events.size()) {
            put(events[i].channel == "DRIVE_ESTIMATE" ? events[i] : events[3], 44, bad_length(4),
                4);
            break;
          }
        break;
      default: {  // the time of a tick
        RawEvent& tick = events[2 + 4 * (at / 8)];
        put(tick.channel == "DRIVE_EVENT" ? events[2] : tick, 16,
            std::int64_t{1} << (40 + below(23)), 8);
      }
    }
  }

  std::vector<RawEvent> whole_;
  std::mt19937_64 random_;
};

}  // namespace twinrate::test

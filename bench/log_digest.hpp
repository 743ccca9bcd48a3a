// The messages of every tick of a log as one number a channel, without session, host_ns and tag: what
// runs of the same drive have in common, bit for bit.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/decode.hpp"
#include "core/event_log.hpp"
#include "model/random.hpp"

namespace twinrate {

struct LogDigest {
  std::array<std::int64_t, kChannelCount> count{};
  std::array<std::uint64_t, kChannelCount> hash{};
  bool operator==(const LogDigest&) const = default;

  template <class Message>
  void add(const lcm::LogEvent& event) {
    Message message{};
    if (decode(message, event.data, static_cast<std::size_t>(event.datalen)))
      add_message(std::move(message));
  }
  template <class Message>
  void add_message(Message message) {
    message.session = message.tag = message.host_ns = 0;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    const auto channel = static_cast<std::size_t>(kChannelOf<Message>);
    ++count[channel];
    for (const std::uint8_t byte : bytes) hash[channel] = splitmix64(hash[channel] ^ byte);
  }
};

// Throws BadInput where there is no whole log.
inline LogDigest digest_of(const std::string& run_dir) {
  LogDigest digest;
  EventLog events(run_dir, OnDamage::kRefuse);
  while (const lcm::LogEvent* event = events.next()) {
    if (events.channel() == Channel::kMeasurement) digest.add<measurement_t>(*event);
    if (events.channel() == Channel::kTruth) digest.add<truth_t>(*event);
    if (events.channel() == Channel::kEstimate) digest.add<estimate_t>(*event);
    if (events.channel() == Channel::kGain) digest.add<gain_t>(*event);
    if (events.channel() == Channel::kReference) digest.add<reference_t>(*event);
    if (events.channel() == Channel::kCommand) digest.add<command_t>(*event);
  }
  return digest;
}

}  // namespace twinrate

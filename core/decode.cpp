#include "core/decode.hpp"

#include <array>
#include <twinrate/command_v4_t.hpp>
#include <twinrate/estimate_v4_t.hpp>
#include <twinrate/event_v2_t.hpp>
#include <twinrate/event_v4_t.hpp>
#include <twinrate/gain_v4_t.hpp>
#include <twinrate/manifest_v4_t.hpp>
#include <twinrate/measurement_v4_t.hpp>
#include <twinrate/reference_v4_t.hpp>
#include <twinrate/reply_v4_t.hpp>
#include <twinrate/request_v4_t.hpp>
#include <twinrate/status_v4_t.hpp>
#include <twinrate/truth_v4_t.hpp>

namespace twinrate {
namespace {

struct Fingerprints {
  std::int64_t today, schema_4;
  std::size_t end;  // bytes that schema 5 appended
};

template <class Today, class Schema4>
Fingerprints of() {
  const bool host_time = requires(Today m) {
    m.host_ns;
  };
  return {Today::getHash(), Schema4::getHash(), host_time ? 16u : 8u};
}

Fingerprints fingerprints_of(Channel channel) {
  static const std::array<Fingerprints, kChannelCount> kFingerprints = {
      of<measurement_t, measurement_v4_t>(),
      of<truth_t, truth_v4_t>(),
      of<estimate_t, estimate_v4_t>(),
      of<gain_t, gain_v4_t>(),
      of<reference_t, reference_v4_t>(),
      of<command_t, command_v4_t>(),
      of<status_t, status_v4_t>(),
      of<event_t, event_v4_t>(),
      of<manifest_t, manifest_v4_t>(),
      of<request_t, request_v4_t>(),
      of<reply_t, reply_v4_t>(),
      {ack_t::getHash(), ack_t::getHash(), 0},  // in no log
  };
  return kFingerprints[static_cast<std::size_t>(channel)];
}

// Offset of waited_for in an event: fingerprint, seq, t_ns, session, role, reason before it.
constexpr std::size_t kWaitedForAt = 40;

void put_fingerprint(std::vector<std::uint8_t>& bytes, std::int64_t fingerprint) {
  for (std::size_t i = 0; i < 8; ++i)
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(fingerprint) >> (56 - 8 * i));
}

}  // namespace

std::int64_t fingerprint_in(const std::uint8_t* bytes, std::size_t size) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8 && size >= 8; ++i) value = value << 8 | bytes[i];
  return static_cast<std::int64_t>(value);
}

bool is_earlier_form(Channel channel, std::int64_t fingerprint) {
  const Fingerprints known = fingerprints_of(channel);
  return fingerprint != known.today &&
         (fingerprint == known.schema_4 ||
          (channel == Channel::kEvent && fingerprint == event_v2_t::getHash()));
}

std::vector<std::uint8_t> in_todays_form(Channel channel, const std::uint8_t* bytes,
                                         std::size_t size) {
  const std::int64_t found = fingerprint_in(bytes, size);
  if (!is_earlier_form(channel, found)) return {};
  const Fingerprints known = fingerprints_of(channel);
  std::vector<std::uint8_t> today(bytes, bytes + size);
  if (found != known.schema_4) {  // an event of schema 2
    if (size < kWaitedForAt) return {};
    today.insert(today.begin() + kWaitedForAt, 4, std::uint8_t{0xff});
  }
  today.resize(today.size() + known.end);
  put_fingerprint(today, known.today);
  return today;
}

}  // namespace twinrate

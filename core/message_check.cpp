#include "core/message_check.hpp"

#include <cmath>
#include <iterator>

#include "core/decode.hpp"
#include "core/message_tag.hpp"
#include "core/utf8.hpp"
#include "model/signals.hpp"

namespace twinrate {
namespace {

constexpr std::int64_t kMaxSeq = std::int64_t{1} << 53;          // exact as a double
constexpr std::int64_t kMaxTime_ns = 3'000'000'000'000'000'000;  // 95 years

std::uint64_t big_endian(const std::uint8_t* bytes, int count) {
  std::uint64_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | bytes[i];
  return value;
}

bool is_text(const std::uint8_t* bytes, std::size_t size) {
  for (std::size_t i = 0; i < size;) {
    const std::size_t length = utf8_sequence(bytes + i, size - i);
    if (bytes[i] == 0 || length == 0) return false;
    i += length;
  }
  return true;
}

// Whether `count` texts from `at` on fill the message up to its tag: length with the final zero byte,
// then bytes.
bool fill(int count, const std::uint8_t* bytes, std::size_t size, std::size_t at) {
  if (size < at + kTagBytes) return false;
  size -= kTagBytes;
  for (; count > 0; --count) {
    if (at + 4 > size) return false;
    const auto length = static_cast<std::int32_t>(big_endian(bytes + at, 4));
    at += 4;
    if (length < 1 || static_cast<std::size_t>(length) > size - at) return false;
    const auto end = at + static_cast<std::size_t>(length) - 1;
    if (bytes[end] != 0 || !is_text(bytes + at, end - at)) return false;
    at = end + 1;
  }
  return at == size;
}

template <class Message>
bool header_fits(const Message& m, std::int64_t first_seq) {
  return m.seq >= first_seq && m.seq <= kMaxSeq && m.t_ns >= -kMaxTime_ns && m.t_ns <= kMaxTime_ns;
}

bool role_fits(int role) {
  return role >= 0 && role < static_cast<int>(std::size(kRoleNames));
}

bool mode_fits(int mode) {
  return mode >= static_cast<int>(Mode::kRun) && mode <= static_cast<int>(Mode::kSafe);
}

// Offsets of the first text: fingerprint, seq, t_ns, session, then the fields of the .lcm file.
bool texts_fit(const void*, const std::uint8_t*, std::size_t) {
  return true;
}
bool texts_fit(const event_t*, const std::uint8_t* bytes, std::size_t size) {
  return fill(1, bytes, size, 44);
}
bool texts_fit(const manifest_t*, const std::uint8_t* bytes, std::size_t size) {
  return fill(3, bytes, size, 36);
}
bool texts_fit(const request_t*, const std::uint8_t* bytes, std::size_t size) {
  return size <= 44 + 4 + kMaxRequestText + 1 + kTagBytes && fill(1, bytes, size, 44);
}
bool texts_fit(const reply_t*, const std::uint8_t* bytes, std::size_t size) {
  return fill(1, bytes, size, 48);
}

bool values_fit(const measurement_t& m) {
  return header_fits(m, 0) && m.signals >= 0 && mode_fits(m.mode);
}
bool values_fit(const truth_t& m) {
  return header_fits(m, 0);
}
bool values_fit(const estimate_t& m) {
  return header_fits(m, 0) && m.status >= 0 && m.gain_seq >= -1 && m.gain_seq <= kMaxSeq;
}
bool values_fit(const gain_t& m) {
  return header_fits(m, 0) && m.first_use_seq >= -1 && m.first_use_seq <= kMaxSeq;
}
bool values_fit(const reference_t& m) {
  return header_fits(m, 0);
}
bool values_fit(const command_t& m) {
  return header_fits(m, 0) && mode_fits(m.mode);
}
bool values_fit(const status_t& m) {
  return header_fits(m, -1) && role_fits(m.role) && m.state >= 0 &&
         m.state <= static_cast<int>(ProcessState::kFailed);
}
bool values_fit(const event_t& m) {
  return header_fits(m, -1) && role_fits(m.role) && m.reason >= 0 &&
         (m.waited_for == -1 || role_fits(m.waited_for));
}
bool values_fit(const manifest_t& m) {
  return header_fits(m, -1);
}
// The sender of a request draws its number: any.
bool values_fit(const request_t& m) {
  return m.t_ns >= -kMaxTime_ns && m.t_ns <= kMaxTime_ns &&
         std::abs(m.value) <= static_cast<double>(kMaxSeq);
}
bool values_fit(const reply_t& m) {
  return m.t_ns >= -kMaxTime_ns && m.t_ns <= kMaxTime_ns && role_fits(m.role);
}
bool values_fit(const ack_t& m) {
  return header_fits(m, -1) && m.n_missing >= 0 && m.n_missing <= 32;
}

template <class Message>
bool decodes(const std::uint8_t* bytes, std::size_t size, std::int64_t& seq, std::int64_t& t_ns) {
  Message message{};
  if (!texts_fit(static_cast<const Message*>(nullptr), bytes, size)) return false;
  if (!decode(message, bytes, size) || !values_fit(message)) return false;
  if (message.getEncodedSize() != static_cast<int>(size)) return false;
  seq = message.seq;
  t_ns = message.t_ns;
  return true;
}

// Calls `use` with a null pointer to the message type of the channel.
template <class Use>
bool with_type(Channel channel, Use use) {
  switch (channel) {
    case Channel::kMeasurement:
      return use(static_cast<measurement_t*>(nullptr));
    case Channel::kTruth:
      return use(static_cast<truth_t*>(nullptr));
    case Channel::kEstimate:
      return use(static_cast<estimate_t*>(nullptr));
    case Channel::kGain:
      return use(static_cast<gain_t*>(nullptr));
    case Channel::kReference:
      return use(static_cast<reference_t*>(nullptr));
    case Channel::kCommand:
      return use(static_cast<command_t*>(nullptr));
    case Channel::kStatus:
      return use(static_cast<status_t*>(nullptr));
    case Channel::kEvent:
      return use(static_cast<event_t*>(nullptr));
    case Channel::kManifest:
      return use(static_cast<manifest_t*>(nullptr));
    case Channel::kRequest:
      return use(static_cast<request_t*>(nullptr));
    case Channel::kReply:
      return use(static_cast<reply_t*>(nullptr));
    case Channel::kAck:
      return use(static_cast<ack_t*>(nullptr));
  }
  return false;
}

}  // namespace

bool has_fingerprint_of(Channel channel, const void* bytes, std::size_t size) {
  const std::int64_t found = fingerprint_in(static_cast<const std::uint8_t*>(bytes), size);
  if (is_earlier_form(channel, found)) return true;
  return with_type(channel,
                   [&](auto* type) { return found == std::decay_t<decltype(*type)>::getHash(); });
}

bool is_whole_message(Channel channel, const void* bytes, std::size_t size, std::int64_t& seq,
                      std::int64_t& t_ns) {
  if (size > kMaxMessageBytes) return false;
  const auto* own = static_cast<const std::uint8_t*>(bytes);
  const std::vector<std::uint8_t> today = in_todays_form(channel, own, size);
  if (!today.empty()) {
    own = today.data();
    size = today.size();
  }
  return with_type(channel, [&](auto* type) {
    return decodes<std::decay_t<decltype(*type)>>(own, size, seq, t_ns);
  });
}

}  // namespace twinrate

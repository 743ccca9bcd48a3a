// Decoding a message whose arrays carry their own length. The lengths are checked first, because
// the generated code would allocate any size that a damaged message contains.
//
// A message of an earlier wire schema is read as a message of today. When a message gains a field,
// lcmtypes/ keeps the earlier type as NAME_vSCHEMA_t, and in_todays_form() gives the new field its
// value for logs without it:
//
//   all         schema 4 has no tag: 0, none; messages of a tick have no host_ns: 0, not known
//   event_t     schema 2 has no waited_for: -1, none
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

// True if the lengths inside an encoded message are ones that this program sends.
bool sizes_fit(const estimate_t*, const std::uint8_t* bytes, std::size_t size);
bool sizes_fit(const gain_t*, const std::uint8_t* bytes, std::size_t size);
inline bool sizes_fit(const void*, const std::uint8_t*, std::size_t) {
  return true;
}

// Offset of the status in an encoded estimate_t: fingerprint and four numbers of 8 bytes before it.
inline constexpr std::uint32_t kEstimateStatusAt = 40;
// Estimate::status of an encoded estimate_t; 0 if the message is too short.
int estimate_status(const std::uint8_t* bytes, std::size_t size);

// The first 8 bytes; 0 if there are fewer.
std::int64_t fingerprint_in(const std::uint8_t* bytes, std::size_t size);
// True if an earlier schema had messages of this channel with this fingerprint.
bool is_earlier_form(Channel channel, std::int64_t fingerprint);
// An encoded message of an earlier schema as one of today; empty for any other.
std::vector<std::uint8_t> in_todays_form(Channel channel, const std::uint8_t* bytes,
                                         std::size_t size);

// False if the bytes are not a message of this type.
template <class Message>
bool decode(Message& message, const void* bytes, std::size_t size) {
  const auto* own = static_cast<const std::uint8_t*>(bytes);
  if (!sizes_fit(&message, own, size)) return false;
  if (message.decode(own, 0, static_cast<int>(size)) >= 0) return true;
  const std::vector<std::uint8_t> today = in_todays_form(kChannelOf<Message>, own, size);
  return !today.empty() && message.decode(today.data(), 0, static_cast<int>(today.size())) >= 0;
}

}  // namespace twinrate

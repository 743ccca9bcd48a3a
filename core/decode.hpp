// Decoding a message whose arrays carry their own length. The lengths are checked first, because
// the generated code would allocate any size that a damaged message contains.
//
// A message of an earlier wire schema is read as a message of today. When a message gains a field,
// lcmtypes/ keeps the earlier type as NAME_vSCHEMA_t, and decode_earlier() gives the new field its
// value for logs without it:
//
//   event_t     schema 2 has no waited_for: -1, none
#pragma once
#include <cstddef>
#include <cstdint>
#include <twinrate/event_v2_t.hpp>

#include "core/channels.hpp"

namespace twinrate {

// Whether the lengths inside an encoded message are ones this program sends.
bool sizes_fit(const estimate_t*, const std::uint8_t* bytes, std::size_t size);
bool sizes_fit(const gain_t*, const std::uint8_t* bytes, std::size_t size);
inline bool sizes_fit(const void*, const std::uint8_t*, std::size_t) {
  return true;
}

// Estimate::status of an encoded estimate_t; 0 where the message is too short for one.
int estimate_status(const std::uint8_t* bytes, std::size_t size);

inline bool decode_earlier(event_t& event, const void* bytes, std::size_t size) {
  event_v2_t earlier;
  if (earlier.decode(bytes, 0, static_cast<int>(size)) < 0) return false;
  event.seq = earlier.seq;
  event.t_ns = earlier.t_ns;
  event.session = earlier.session;
  event.role = earlier.role;
  event.reason = earlier.reason;
  event.waited_for = -1;
  event.text = earlier.text;
  return true;
}
template <class Message>
bool decode_earlier(Message&, const void*, std::size_t) {
  return false;
}

// False where the bytes are not such a message.
template <class Message>
bool decode(Message& message, const void* bytes, std::size_t size) {
  return sizes_fit(&message, static_cast<const std::uint8_t*>(bytes), size) &&
         (message.decode(bytes, 0, static_cast<int>(size)) >= 0 ||
          decode_earlier(message, bytes, size));
}

}  // namespace twinrate

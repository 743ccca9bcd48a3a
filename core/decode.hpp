// Decoding a message whose arrays carry their own length: the lengths are looked at first, because
// the generated code would reserve whatever a damaged message asks for.
#pragma once
#include <cstddef>
#include <cstdint>

#include "core/channels.hpp"

namespace twinrate {

// Whether the lengths inside an encoded message are ones this program sends.
bool sizes_fit(const estimate_t*, const std::uint8_t* bytes, std::size_t size);
bool sizes_fit(const gain_t*, const std::uint8_t* bytes, std::size_t size);
inline bool sizes_fit(const void*, const std::uint8_t*, std::size_t) {
  return true;
}

// False where the bytes are not such a message.
template <class Message>
bool decode(Message& message, const void* bytes, std::size_t size) {
  return sizes_fit(&message, static_cast<const std::uint8_t*>(bytes), size) &&
         message.decode(bytes, 0, static_cast<int>(size)) >= 0;
}

}  // namespace twinrate

// Checks a message of unknown origin before anything decodes it.
//
// The generated code allocates any size that a damaged message contains, and a text of length 0 or
// below ends the program. Lengths, ranges, enumerations and texts (UTF-8 without a zero byte) are
// checked here.
#pragma once
#include <cstddef>
#include <cstdint>

#include "core/channels.hpp"

namespace twinrate {

inline constexpr std::size_t kMaxMessageBytes = 16 << 20;  // a drive file and its tables: 100 kB
// Every process parses a request on its tick thread: the text fits into one datagram.
inline constexpr std::size_t kMaxRequestText = 60'000;  // bytes; a cogging: 100

// Whether the bytes begin with the fingerprint of a type of this channel.
bool has_fingerprint_of(Channel channel, const void* bytes, std::size_t size);
// Whether the bytes are one message of this channel that this program could have sent. Sets `seq`
// and `t_ns`.
bool is_whole_message(Channel channel, const void* bytes, std::size_t size, std::int64_t& seq,
                      std::int64_t& t_ns);

}  // namespace twinrate

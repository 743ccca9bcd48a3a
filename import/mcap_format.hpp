// The MCAP container, https://mcap.dev/spec: common parts of writer and reader.
#pragma once
#include <cstdint>
#include <string_view>

namespace twinrate::mcap {

inline constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

enum Opcode : std::uint8_t {
  kHeader = 1,
  kFooter = 2,
  kSchema = 3,
  kChannelRecord = 4,
  kMessage = 5,
  kChunk = 6,
  kMessageIndex = 7,
  kChunkIndex = 8,
  kStatistics = 11,
  kDataEnd = 15,
};

// Members of a message's JSON beside its fields: with them a message of the log is made again.
inline constexpr const char* kOriginNames[] = {"t_ns", "session", "tag", "timestamp_us"};

}  // namespace twinrate::mcap

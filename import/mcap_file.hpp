// Reads an MCAP file (mcap_format.hpp) from front to back, without its index.
//
// The reader is meant for files of unknown origin: every length is checked against the bytes that
// are there, a chunk is unpacked up to kMaxChunkBytes, and its CRC is compared. Memory: one chunk.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace twinrate {

inline constexpr std::size_t kMaxChunkBytes = std::size_t{256} << 20;

struct McapMessage {
  std::string_view topic, schema, encoding;  // of its channel
  std::string_view text;                     // valid during the call
};

// Calls `take` with every message in the order of the file; `progress` gets the share read. Throws
// BadInput, one line: no such file, not MCAP, damaged, another compression than zstd and lz4; and
// the exceptions of the two functions.
void read_mcap(const std::string& path, const std::function<void(const McapMessage&)>& take,
               const std::function<void(double)>& progress);

}  // namespace twinrate

// The readers of input that nobody vouches for, one function each: bytes in, no crash, no hang, no
// memory beyond the input's size. A refusal (BadInput) is a good end. bench/fuzz and
// tests/fuzz/corpus_test.cpp call them.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace twinrate::fuzz {

using Bytes = std::vector<std::uint8_t>;

void message(const std::uint8_t* bytes,
             std::size_t size);  // first byte: channel; then the datagram
void request(const std::uint8_t* bytes, std::size_t size);     // text of a request for effects
void log_file(const std::uint8_t* bytes, std::size_t size);    // an LCM log
void drive_file(const std::uint8_t* bytes, std::size_t size);  // TOML
void csv_file(const std::uint8_t* bytes, std::size_t size);    // a measured file

struct Reader {
  const char* name;
  void (*read)(const std::uint8_t* bytes, std::size_t size);
  std::vector<Bytes> (*seeds)();  // whole inputs of today's formats
};
extern const std::vector<Reader> kReaders;

}  // namespace twinrate::fuzz

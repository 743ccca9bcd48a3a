// UTF-8, checked byte by byte.
#pragma once
#include <cstddef>
#include <cstdint>

namespace twinrate {

// Length of the sequence that begins at `bytes`, with at most `size` bytes; 0 if there is no valid
// one.
inline std::size_t utf8_sequence(const std::uint8_t* bytes, std::size_t size) {
  const std::uint8_t first = bytes[0];
  std::size_t length = 0;
  if (first < 0x80)
    length = 1;
  else if (first >= 0xc2 && first < 0xe0)
    length = 2;
  else if (first >= 0xe0 && first < 0xf0)
    length = 3;
  else if (first >= 0xf0 && first < 0xf5)
    length = 4;
  if (length == 0 || length > size) return 0;
  for (std::size_t j = 1; j < length; ++j)
    if ((bytes[j] & 0xc0) != 0x80) return 0;
  const bool longer_than_needed =
      (first == 0xe0 && bytes[1] < 0xa0) || (first == 0xf0 && bytes[1] < 0x90);
  const bool no_character = (first == 0xed && bytes[1] > 0x9f) ||  // half of a UTF-16 pair
                            (first == 0xf4 && bytes[1] > 0x8f);    // above U+10FFFF
  return longer_than_needed || no_character ? 0 : length;
}

}  // namespace twinrate

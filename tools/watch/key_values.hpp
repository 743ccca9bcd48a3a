// The main fields of a message, with the names of lcmtypes/.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct KeyValues {
  struct Number {
    const char* key;
    double value;
  };
  std::vector<Number> numbers;
  std::string text;  // mode, reason, request: in words
  bool decoded = true;
};

KeyValues key_values(Channel channel, const std::vector<std::uint8_t>& bytes);
// "omega_m 41.2 rad/s, i_q 0.31 A, run"
std::string to_text(const KeyValues& values);

}  // namespace twinrate

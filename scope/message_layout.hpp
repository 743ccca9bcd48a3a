// The fields of every message, from lcmtypes/*.lcm: name, unit, comment, and the numbers of an
// encoded message.
//
// The .lcm files are embedded in the program (cmake/embed.cmake). An encoded message is a
// fingerprint of 8 bytes followed by its fields in the order of the file, big-endian; a text is its
// length and its bytes with a zero at the end. A message of an earlier layout is shorter: its last
// fields have no value. Check messages of unknown origin first (core/message_check.hpp).
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate::scope {

struct LayoutField {
  enum class Type { kInt32, kInt64, kDouble, kText };
  std::string name;     // without its unit: "omega_m"
  std::string wire;     // as in the message: "omega_m_rad_s"
  std::string unit;     // "rad/s"; "" if it has none
  std::string comment;  // of the .lcm file
  Type type = Type::kDouble;
  bool array = false;
  int length_field = -1;  // of an array: the field that holds its length; -1: `length`
  int length = 1;
};

struct MessageLayout {
  Channel channel = Channel::kAck;
  std::string short_name;  // "estimate"
  std::vector<LayoutField> fields;
};

// Throws std::runtime_error if the text is no message of this project.
MessageLayout parse_layout(Channel channel, const std::string& lcm_text);
// The present layout of a channel's message.
const MessageLayout& layout_of(Channel channel);

// Calls `number` for each number with the index of its field and of its element.
void read_numbers(const MessageLayout& layout, const std::uint8_t* bytes, std::size_t size,
                  const std::function<void(int field, int element, double value)>& number);

}  // namespace twinrate::scope

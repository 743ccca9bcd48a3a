// A message of a tick as LCM encodes it: fingerprint, header, the fields in the order of lcmtypes/ and
// the tag, each number in network order. LCM's own encode() checks the room before each number in a
// call of its own; here the caller gives getEncodedSize() bytes.
#pragma once
#include <endian.h>

#include <bit>
#include <cstring>

#include "core/message_fields.hpp"

namespace twinrate {

class NetworkOrder {
 public:
  explicit NetworkOrder(std::uint8_t* to) : at_(to) {}
  void put(std::int64_t number) { append(htobe64(static_cast<std::uint64_t>(number))); }
  void put(double number) { append(htobe64(std::bit_cast<std::uint64_t>(number))); }
  void put(std::int32_t number) { append(htobe32(static_cast<std::uint32_t>(number))); }
  // The visitor of each_field().
  template <class Number>
  void operator()(const char* /*name*/, Number number) {
    put(number);
  }
  void operator()(const char* /*name*/, const std::vector<double>& numbers, std::int32_t used) {
    for (std::int32_t i = 0; i < used; ++i) put(numbers[static_cast<std::size_t>(i)]);
  }

 private:
  template <class Bits>
  void append(Bits bits) {
    std::memcpy(at_, &bits, sizeof bits);
    at_ += sizeof bits;
  }
  std::uint8_t* at_;
};

template <class Message>
void encode_tick(Message& message, std::uint8_t* to) {
  NetworkOrder out(to);
  out.put(Message::getHash());
  out.put(message.seq);
  out.put(message.t_ns);
  out.put(message.session);
  each_field(message, out);
  out.put(message.tag);
}

}  // namespace twinrate

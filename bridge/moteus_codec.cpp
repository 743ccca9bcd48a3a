#include "bridge/moteus_codec.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cstring>

namespace twinrate {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::array<std::size_t, 16> kCanLengths = {0, 1,  2,  3,  4,  5,  6,  7,
                                                     8, 12, 16, 20, 24, 32, 48, 64};
constexpr std::size_t kMaxCan = 64;

void put_head(Bytes& frame, int kind, int first, std::size_t count) {
  const bool fits = count <= 3;
  frame.push_back(static_cast<std::uint8_t>(kind | (fits ? static_cast<int>(count) : 0)));
  if (!fits) frame.push_back(static_cast<std::uint8_t>(count));
  frame.push_back(static_cast<std::uint8_t>(first));  // every register used here is below 128
}

void put_floats(Bytes& frame, std::span<const float> values) {
  for (const float value : values) {
    std::uint8_t bytes[4];
    std::memcpy(bytes, &value, 4);
    frame.insert(frame.end(), bytes, bytes + 4);
  }
}

class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  bool at_end() const { return at_ >= bytes_.size(); }
  bool failed() const { return failed_; }
  std::uint32_t byte() {
    if (at_end()) return failed_ = true, 0;
    return bytes_[at_++];
  }
  std::uint32_t varuint() {
    std::uint32_t value = 0;
    for (int shift = 0; shift < 35; shift += 7) {
      const std::uint32_t b = byte();
      value |= (b & 0x7f) << shift;
      if (!(b & 0x80)) return value;
    }
    return failed_ = true, 0;
  }
  // kind: 0 int8, 1 int16, 2 int32, 3 float.
  double value(int kind) {
    const int size = kind == 0 ? 1 : kind == 1 ? 2 : 4;
    std::uint32_t bits = 0;
    for (int i = 0; i < size; ++i) bits |= byte() << (8 * i);
    if (kind == 0) return static_cast<std::int8_t>(bits);
    if (kind == 1) return static_cast<std::int16_t>(bits);
    if (kind == 2) return static_cast<std::int32_t>(bits);
    float x = 0;
    std::memcpy(&x, &bits, 4);
    return static_cast<double>(x);
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool failed_ = false;
};

}  // namespace

void put_moteus_read(Bytes& frame, int first, int count) {
  put_head(frame, 0x1c, first, static_cast<std::size_t>(count));
}
void put_moteus_write(Bytes& frame, int first, std::span<const float> values) {
  put_head(frame, 0x0c, first, values.size());
  put_floats(frame, values);
}
void put_moteus_write_int8(Bytes& frame, int first, int value) {
  put_head(frame, 0x00, first, 1);
  frame.push_back(static_cast<std::uint8_t>(value));
}
void put_moteus_reply(Bytes& frame, int first, std::span<const float> values) {
  put_head(frame, 0x2c, first, values.size());
  put_floats(frame, values);
}
void pad_moteus(Bytes& frame) {
  for (const std::size_t length : kCanLengths)
    if (length >= frame.size()) return frame.resize(length, 0x50);
}

MoteusFrame parse_moteus(std::span<const std::uint8_t> bytes) {
  MoteusFrame frame;
  Reader r(bytes);
  while (!r.at_end() && !r.failed()) {
    const std::uint32_t head = r.byte();
    if (head == 0x50) continue;
    const std::uint32_t group = head >> 4;  // 0 write, 1 read, 2 reply
    if (group > 2) {
      frame.bad = true;
      break;
    }
    const int kind = static_cast<int>(head >> 2 & 3);
    const std::uint32_t count = (head & 3) ? head & 3 : r.varuint();
    const std::uint32_t first = r.varuint();
    for (std::uint32_t i = 0; i < count && i < kMaxCan && !r.failed(); ++i) {
      const int reg = static_cast<int>((first + i) & 0xffff);
      if (group == 1) {
        frame.reads.push_back(reg);
        continue;
      }
      const double value = r.value(kind);
      if (!r.failed()) (group == 0 ? frame.writes : frame.replies)[reg] = value;
    }
  }
  frame.bad = frame.bad || r.failed();
  return frame;
}

std::optional<CanLine> parse_can_line(std::string_view line, std::string_view verb) {
  if (!line.starts_with(verb)) return {};
  line.remove_prefix(verb.size());
  const auto word = [&] {
    while (!line.empty() && line.front() == ' ') line.remove_prefix(1);
    const std::string_view found = line.substr(0, line.find(' '));
    line.remove_prefix(found.size());
    return found;
  };
  const std::string_view id = word(), hex = word();
  CanLine can;
  if (id.empty() ||
      std::from_chars(id.data(), id.data() + id.size(), can.id, 16).ptr != id.data() + id.size())
    return {};
  if (hex.empty() || hex.size() % 2 != 0 || hex.size() > 2 * kMaxCan) return {};
  for (std::size_t i = 0; i < hex.size(); i += 2) {
    unsigned byte = 0;
    if (std::from_chars(hex.data() + i, hex.data() + i + 2, byte, 16).ptr != hex.data() + i + 2)
      return {};
    can.bytes.push_back(static_cast<std::uint8_t>(byte));
  }
  return can;
}

std::string can_line(std::string_view verb, int id, std::span<const std::uint8_t> bytes) {
  std::string line = fmt::format("{} {:x} ", verb, id);
  for (const std::uint8_t byte : bytes) line += fmt::format("{:02x}", byte);
  return line;
}

}  // namespace twinrate

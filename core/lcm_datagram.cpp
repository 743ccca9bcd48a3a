#include "core/lcm_datagram.hpp"

#include <algorithm>
#include <cstring>

#include "core/message_check.hpp"

namespace twinrate {
namespace {

std::uint32_t big_endian_32(const std::uint8_t* bytes) {
  return std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 |
         std::uint32_t{bytes[2]} << 8 | bytes[3];
}

std::uint16_t big_endian_16(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[0] << 8 | bytes[1]);
}

void put_32(std::uint8_t* bytes, std::size_t number) {
  for (int i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(number >> (24 - 8 * i));
}

void put_16(std::uint8_t* bytes, std::uint16_t number) {
  bytes[0] = static_cast<std::uint8_t>(number >> 8);
  bytes[1] = static_cast<std::uint8_t>(number);
}

// The channel that begins at `bytes`, without its zero byte; false if there is none, or if it is
// longer than LCM allows.
bool parse_channel(const std::uint8_t* bytes, std::size_t size, std::string_view& channel) {
  const void* end = std::memchr(bytes, 0, std::min(size, kMaxChannelLength + 1));
  if (!end) return false;
  channel = {reinterpret_cast<const char*>(bytes),
             static_cast<std::size_t>(static_cast<const std::uint8_t*>(end) - bytes)};
  return !channel.empty();
}

}  // namespace

Reassembly::Outcome Reassembly::take(const std::uint8_t* datagram, std::size_t size,
                                     std::uint64_t sender, std::int64_t now_ns,
                                     LcmMessage& message) {
  if (size < kWholeHeader) return Outcome::kMalformed;
  if (big_endian_32(datagram) == kWholeMagic) {
    if (!parse_channel(datagram + kWholeHeader, size - kWholeHeader, message.channel))
      return Outcome::kMalformed;
    const std::size_t header = kWholeHeader + message.channel.size() + 1;
    message.bytes = datagram + header;
    message.size = size - header;
    return Outcome::kWhole;
  }
  Fragment fragment{};
  if (!parse(datagram, size, fragment)) return Outcome::kMalformed;
  return take_fragment(fragment, sender, now_ns, message);
}

bool Reassembly::parse(const std::uint8_t* datagram, std::size_t size, Fragment& f) {
  if (size < kFragmentHeader || big_endian_32(datagram) != kFragmentMagic) return false;
  f.sequence = big_endian_32(datagram + 4);
  f.message_size = big_endian_32(datagram + 8);
  f.offset = big_endian_32(datagram + 12);
  f.number = big_endian_16(datagram + 16);
  f.count = big_endian_16(datagram + 18);
  f.bytes = datagram + kFragmentHeader;
  f.size = size - kFragmentHeader;
  if (f.number >= f.count || f.message_size > kMaxMessageBytes || f.count > f.message_size + 1)
    return false;
  if (f.number == 0) {
    if (!parse_channel(f.bytes, f.size, f.channel)) return false;
    f.bytes += f.channel.size() + 1;
    f.size -= f.channel.size() + 1;
  }
  return f.size <= f.message_size && f.offset <= f.message_size - f.size;
}

void Reassembly::give_up(std::size_t index) {
  parts_.erase(parts_.begin() + static_cast<std::ptrdiff_t>(index));
  ++given_up_;
}

void Reassembly::give_up_old(std::int64_t now_ns) {
  for (std::size_t i = parts_.size(); i-- > 0;)
    if (now_ns - parts_[i].begun_ns > kReassemblyPatience_ns) give_up(i);
}

std::size_t Reassembly::bytes_held() const {
  std::size_t sum = 0;
  for (const Parts& parts : parts_) sum += parts.received_bytes;
  return sum;
}

Reassembly::Parts& Reassembly::parts_of(const Fragment& f, std::uint64_t sender,
                                        std::int64_t now_ns) {
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    Parts& parts = parts_[i];
    if (parts.sender != sender || parts.sequence != f.sequence) continue;
    if (parts.message_size == f.message_size && parts.received.size() == f.count) return parts;
    give_up(i);  // another message under the same number
    break;
  }
  if (parts_.size() == kMaxReassemblies) give_up(0);
  parts_.push_back({.sender = sender,
                    .sequence = f.sequence,
                    .message_size = f.message_size,
                    .begun_ns = now_ns,
                    .channel = {},
                    .received = std::vector<bool>(f.count),
                    .pieces = {}});
  return parts_.back();
}

Reassembly::Outcome Reassembly::take_fragment(const Fragment& f, std::uint64_t sender,
                                              std::int64_t now_ns, LcmMessage& message) {
  give_up_old(now_ns);
  Parts& parts = parts_of(f, sender, now_ns);
  if (parts.received[f.number]) return Outcome::kPart;  // it came twice
  if (f.number == 0) parts.channel = f.channel;
  parts.received[f.number] = true;
  parts.pieces.emplace_back(f.offset, std::vector<std::uint8_t>(f.bytes, f.bytes + f.size));
  parts.received_bytes += f.size;
  if (parts.pieces.size() == parts.received.size()) {
    const auto place = parts_.begin() + (&parts - parts_.data());
    const Parts complete = std::move(*place);
    parts_.erase(place);
    return join(complete, message);
  }
  while (bytes_held() > kMaxReassemblyBytes) give_up(0);
  return Outcome::kPart;
}

Reassembly::Outcome Reassembly::join(const Parts& parts, LcmMessage& message) {
  if (parts.received_bytes != parts.message_size) return Outcome::kMalformed;
  whole_channel_ = parts.channel;
  whole_.assign(parts.message_size, 0);
  for (const auto& [offset, piece] : parts.pieces)
    std::copy(piece.begin(), piece.end(), whole_.begin() + static_cast<std::ptrdiff_t>(offset));
  message = {whole_channel_, whole_.data(), whole_.size()};
  return Outcome::kWhole;
}

Datagrams::Datagrams(std::string_view channel, const std::uint8_t* bytes, std::size_t size,
                     std::uint32_t sequence)
    : channel_size_(channel.size() + 1), bytes_(bytes), size_(size), sequence_(sequence) {
  const std::size_t all = channel_size_ + size_;
  count_ =
      static_cast<std::uint16_t>(all <= kMaxWhole ? 1 : (all + kMaxFragment - 1) / kMaxFragment);
}

bool Datagrams::next() {
  if (number_ == count_) return false;
  first_ = number_ == 0;
  offset_ += part_;
  const std::size_t room = count_ == 1 ? kMaxWhole : kMaxFragment;
  part_ = std::min(size_ - offset_, first_ ? room - channel_size_ : room);
  put_32(header_, count_ == 1 ? kWholeMagic : kFragmentMagic);
  put_32(header_ + 4, sequence_);
  header_size_ = count_ == 1 ? kWholeHeader : kFragmentHeader;
  if (count_ > 1) {
    put_32(header_ + 8, size_);
    put_32(header_ + 12, offset_);
    put_16(header_ + 16, number_);
    put_16(header_ + 18, count_);
  }
  ++number_;
  return true;
}

}  // namespace twinrate

// LCM's datagrams: a message in one (LC02) or in several (LC03).
//
//   LC02   "LC02", sequence number, channel and zero byte, payload
//   LC03   "LC03", sequence number, payload size, offset in the payload, number of the fragment,
//          number of fragments; in the first fragment channel and zero byte; part of the payload
//
// All numbers are big-endian, 4 bytes, the last two 2 bytes. Announced sizes are not trusted:
// memory grows with the received bytes, up to kMaxReassemblyBytes for all incomplete messages of
// all senders together. A further message, or one that is incomplete after kReassemblyPatience_ns,
// replaces the oldest. Source: lcm/udpm_util.h, LCM 1.3.1.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace twinrate {

inline constexpr std::uint32_t kWholeMagic = 0x4c433032, kFragmentMagic = 0x4c433033;
inline constexpr std::size_t kWholeHeader = 8, kFragmentHeader = 20;
// Largest payload and channel of an LC02 datagram, and of one fragment.
inline constexpr std::size_t kMaxWhole = 65499, kMaxFragment = 65487;
inline constexpr std::size_t kMaxChannelLength = 63;

inline constexpr std::size_t kMaxReassemblies = 8;
inline constexpr std::size_t kMaxReassemblyBytes = 32 << 20;
inline constexpr std::int64_t kReassemblyPatience_ns = 2'000'000'000;

// A message as it came; the bytes belong to the receiver.
struct LcmMessage {
  std::string_view channel;
  const std::uint8_t* bytes = nullptr;
  std::size_t size = 0;
  std::int64_t arrival_us = 0;  // of its last datagram, wall clock; 0: unknown
  std::uint64_t sender = 0;     // IP address and port, network byte order
};

class Reassembly {
 public:
  enum class Outcome { kWhole, kPart, kMalformed };

  // `sender`: address and port. `message` is set if the outcome is kWhole, and valid until the next
  // call; it points into `datagram` or into this object.
  Outcome take(const std::uint8_t* datagram, std::size_t size, std::uint64_t sender,
               std::int64_t now_ns, LcmMessage& message);
  // Incomplete messages that were given up.
  std::int64_t given_up() const { return given_up_; }
  std::size_t bytes_held() const;

 private:
  struct Fragment {
    std::uint32_t message_size, offset, sequence;
    std::uint16_t number, count;
    std::string_view channel;  // of the first one
    const std::uint8_t* bytes;
    std::size_t size;
  };
  struct Parts {
    std::uint64_t sender = 0;
    std::uint32_t sequence = 0, message_size = 0;
    std::int64_t begun_ns = 0;
    std::size_t received_bytes = 0;
    std::string channel;
    std::vector<bool> received;
    std::vector<std::pair<std::size_t, std::vector<std::uint8_t>>> pieces;  // by offset
  };

  static bool parse(const std::uint8_t* datagram, std::size_t size, Fragment& fragment);
  Outcome take_fragment(const Fragment& fragment, std::uint64_t sender, std::int64_t now_ns,
                        LcmMessage& message);
  Parts& parts_of(const Fragment& fragment, std::uint64_t sender, std::int64_t now_ns);
  Outcome join(const Parts& parts, LcmMessage& message);
  void give_up(std::size_t index);
  void give_up_old(std::int64_t now_ns);

  std::vector<Parts> parts_;  // the oldest first
  std::string whole_channel_;
  std::vector<std::uint8_t> whole_;
  std::int64_t given_up_ = 0;
};

// The datagrams of a message, one after the other, as liblcm makes them.
class Datagrams {
 public:
  Datagrams(std::string_view channel, const std::uint8_t* bytes, std::size_t size,
            std::uint32_t sequence);
  // The next datagram is header, channel with its zero byte (if any) and part of the payload; false
  // after the last.
  bool next();
  const std::uint8_t* header() const { return header_; }
  std::size_t header_size() const { return header_size_; }
  bool names_channel() const { return first_; }
  const std::uint8_t* payload() const { return bytes_ + offset_; }
  std::size_t payload_size() const { return part_; }

 private:
  std::size_t channel_size_;  // with its zero byte
  const std::uint8_t* bytes_;
  std::size_t size_, offset_ = 0, part_ = 0, header_size_ = 0;
  std::uint32_t sequence_;
  std::uint16_t count_, number_ = 0;
  bool first_ = false;
  std::uint8_t header_[kFragmentHeader] = {};
};

}  // namespace twinrate

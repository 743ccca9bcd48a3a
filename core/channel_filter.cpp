#include "core/channel_filter.hpp"

#include <linux/filter.h>
#include <sys/socket.h>

#include "core/decode.hpp"
#include "core/lcm_datagram.hpp"
#include "model/signals.hpp"

namespace twinrate {
namespace {

// From the UDP header on: 8 bytes of it, LCM's magic and sequence number, then the channel's name.
constexpr std::uint32_t kMagicAt = 8, kChannelAt = 16, kNameAt = kChannelAt + 6;  // after "DRIVE_"
constexpr std::uint32_t kSessionAt = 24;  // after the type's hash, seq and t_ns
constexpr std::uint32_t kAll = 0xffffffff, kNone = 0;

std::uint32_t first_four(const std::string& text) {
  std::uint32_t key = 0;
  for (std::size_t i = 0; i < 4; ++i)
    key = key << 8 | (i < text.size() ? static_cast<std::uint8_t>(text[i]) : 0u);
  return key;
}

sock_filter load(std::uint32_t at) {
  return BPF_STMT(BPF_LD | BPF_W | BPF_ABS, at);
}
sock_filter jump(std::uint16_t test, std::uint32_t number, std::size_t then,
                 std::size_t otherwise) {
  return BPF_JUMP(static_cast<std::uint16_t>(BPF_JMP | test | BPF_K), number,
                  static_cast<std::uint8_t>(then), static_cast<std::uint8_t>(otherwise));
}
sock_filter give(std::uint32_t bytes) {
  return BPF_STMT(BPF_RET | BPF_K, bytes);
}

// Passes the estimates that a gain process can use; one that is too short to decide passes and is
// counted. The machine has 32 bits:
//   seq mod n = ((upper mod n) (2^32 mod n) mod n + lower mod n) mod n
std::vector<sock_filter> every_nth(const WantedChannel& channel) {
  const auto payload = static_cast<std::uint32_t>(kChannelAt + channel.name.size() + 1);
  const auto wrap = static_cast<std::uint32_t>((std::uint64_t{1} << 32) % channel.every);
  return {BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
          jump(BPF_JGE, payload + kEstimateStatusAt + 4, 0, 17),
          load(payload + kEstimateStatusAt),
          jump(BPF_JSET, kGainEveryTick, 15, 0),
          load(payload + 8),  // seq, upper half
          jump(BPF_JEQ, 0, 0, 2),
          load(payload + 12),
          jump(BPF_JGE, channel.from, 0, 11),
          load(payload + 8),
          BPF_STMT(BPF_ALU | BPF_MOD | BPF_K, channel.every),
          BPF_STMT(BPF_ALU | BPF_MUL | BPF_K, wrap),
          BPF_STMT(BPF_ALU | BPF_MOD | BPF_K, channel.every),
          BPF_STMT(BPF_MISC | BPF_TAX, 0),
          load(payload + 12),
          BPF_STMT(BPF_ALU | BPF_MOD | BPF_K, channel.every),
          BPF_STMT(BPF_ALU | BPF_ADD | BPF_X, 0),
          BPF_STMT(BPF_ALU | BPF_MOD | BPF_K, channel.every),
          jump(BPF_JEQ, 0, 1, 0),
          give(kNone),
          give(kAll)};
}

// Of the right session; ends with the next instruction, for such a message, if `goes_on`.
std::vector<sock_filter> of_session(const WantedChannel& channel, bool goes_on) {
  const auto at = static_cast<std::uint32_t>(kChannelAt + channel.name.size() + 1 + kSessionAt);
  const auto session = static_cast<std::uint64_t>(channel.session);
  return {BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
          jump(BPF_JGE, at + 8, 0, 5),
          load(at),
          jump(BPF_JEQ, static_cast<std::uint32_t>(session >> 32), 0, 2),
          load(at + 4),
          jump(BPF_JEQ, static_cast<std::uint32_t>(session), goes_on ? 2 : 1, 0),
          give(kNone),
          give(kAll)};
}

}  // namespace

bool filter_channels(int socket, const std::vector<WantedChannel>& channels) {
  const std::size_t count = channels.size();
  std::vector<sock_filter> program = {load(kMagicAt), jump(BPF_JEQ, kWholeMagic, 0, count + 2),
                                      load(kNameAt)};
  std::vector<sock_filter> tail = {give(kNone), give(kAll)};
  for (std::size_t i = 0; i < count; ++i) {
    const bool thin = channels[i].every > 1, one_session = channels[i].session != 0;
    const std::size_t to_tail = count - 1 - i;
    program.push_back(jump(BPF_JEQ, first_four(channels[i].name.substr(6)),
                           to_tail + (thin || one_session ? tail.size() : 1), 0));
    const auto add = [&tail](const std::vector<sock_filter>& part) {
      tail.insert(tail.end(), part.begin(), part.end());
    };
    if (one_session) add(of_session(channels[i], thin));
    if (thin) add(every_nth(channels[i]));
  }
  program.insert(program.end(), tail.begin(), tail.end());
  const sock_fprog filter{.len = static_cast<unsigned short>(program.size()),
                          .filter = program.data()};
  return setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

}  // namespace twinrate

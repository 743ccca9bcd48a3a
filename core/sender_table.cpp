#include "core/sender_table.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include "core/bus.hpp"

namespace twinrate {
namespace {

// After fingerprint, seq, t_ns and session, 8 bytes each; the status has its config hash before it.
constexpr std::size_t kRoleAt = 32, kRoleOfStatusAt = 40;

std::int32_t big_endian_32(const std::uint8_t* bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8 | bytes[i];
  return static_cast<std::int32_t>(value);
}

// The role that sends on a channel of a tick. A bridge has the role of a plant; a reference can
// come from a process of its own.
int owner_of(Channel channel) {
  switch (channel) {
    case Channel::kMeasurement:
    case Channel::kTruth:
      return static_cast<int>(Role::kPlant);
    case Channel::kEstimate:
      return static_cast<int>(Role::kEstimator);
    case Channel::kGain:
      return static_cast<int>(Role::kGain);
    case Channel::kCommand:
      return static_cast<int>(Role::kController);
    default:
      return -1;
  }
}

}  // namespace

std::string text_of(SocketName socket) {
  const in_addr address{.s_addr = static_cast<in_addr_t>(socket >> 16)};
  std::array<char, INET_ADDRSTRLEN> text{};
  inet_ntop(AF_INET, &address, text.data(), text.size());
  return fmt::format("{} port {}", text.data(), ntohs(static_cast<std::uint16_t>(socket)));
}

int role_of(Channel channel, const std::uint8_t* bytes) {
  if (channel == Channel::kStatus) return big_endian_32(bytes + kRoleOfStatusAt);
  if (channel == Channel::kEvent || channel == Channel::kReply)
    return big_endian_32(bytes + kRoleAt);
  return -1;
}

// Of a message without a sender of its own: the last one.
std::size_t SenderTable::key_of(Channel channel, const std::uint8_t* bytes) {
  constexpr std::size_t kRoles = std::size(kRoleNames);
  if (channel < Channel::kStatus) return static_cast<std::size_t>(channel);
  const bool of_logger = channel == Channel::kAck || channel == Channel::kManifest;
  const int role = of_logger ? static_cast<int>(Role::kLogger) : role_of(channel, bytes);
  if (role < 0 || role >= static_cast<int>(kRoles)) return kTickChannels + kRoles;
  return kTickChannels + static_cast<std::size_t>(role);
}

// Any message of a role shows that the sender of its channels is present as well.
void SenderTable::heard(std::size_t key) {
  known_[key].silent_since_ns = 0;
  if (key < kTickChannels) return;
  for (std::size_t channel = 0; channel < kTickChannels; ++channel)
    if (owner_of(static_cast<Channel>(channel)) == static_cast<int>(key - kTickChannels))
      known_[channel].silent_since_ns = 0;
}

bool SenderTable::admits(Channel channel, const std::uint8_t* bytes, SocketName sender) {
  const std::size_t key = key_of(channel, bytes);
  if (sender == 0 || key + 1 == known_.size()) return true;
  Known& known = known_[key];
  if (known.sender == sender) {
    heard(key);
    return true;
  }
  if (known.sender != 0) {
    const std::int64_t now_ns = host_now_ns();
    if (known.silent_since_ns == 0) known.silent_since_ns = now_ns;
    if (now_ns - known.silent_since_ns < kSilent_ns) return false;
  }
  known.sender = sender;
  heard(key);
  return true;
}

void SenderTable::forget(Role role) {
  known_[kTickChannels + static_cast<std::size_t>(role)] = {};
  for (std::size_t channel = 0; channel < kTickChannels; ++channel)
    if (owner_of(static_cast<Channel>(channel)) == static_cast<int>(role)) known_[channel] = {};
}

}  // namespace twinrate

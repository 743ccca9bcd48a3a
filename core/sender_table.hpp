// The senders of a session: a role has one instance, identified by the socket from which it sends.
//
// The first sender heard on a channel of a tick is its sender. DRIVE_STATUS, DRIVE_EVENT and
// DRIVE_REPLY have the first sender of each role, DRIVE_ACK and DRIVE_MANIFEST that of the logger.
// A message from another socket comes from a second sender, even with a valid tag. The second
// sender replaces the first one if the first is silent for kSilent_ns while the second sends: the
// process was restarted.
//
// DRIVE_REQUEST has no sender of its own: everyone with the token may send a request. A receiver
// can look up the role of its socket.
#pragma once
#include <array>
#include <cstdint>
#include <iterator>
#include <string>

#include "core/channels.hpp"

namespace twinrate {

// IP address and port in network byte order, as (address << 16 | port); 0: unknown.
using SocketName = std::uint64_t;
std::string text_of(SocketName socket);

class SenderTable {
 public:
  static constexpr std::int64_t kSilent_ns = 500'000'000;

  // Whether a whole message comes from the sender of its channel or role.
  bool admits(Channel channel, const std::uint8_t* bytes, SocketName sender);
  // Whether this socket is known as that of the role.
  bool is(Role role, SocketName sender) const {
    return known_[kTickChannels + static_cast<std::size_t>(role)].sender == sender;
  }
  // The next sender of this role and of its channels is the one.
  void forget(Role role);

 private:
  static constexpr std::size_t kTickChannels = static_cast<std::size_t>(Channel::kStatus);
  struct Known {
    SocketName sender = 0;
    std::int64_t silent_since_ns = 0;  // a second one was heard then, and nothing of this one since
  };
  static std::size_t key_of(Channel channel, const std::uint8_t* bytes);
  void heard(std::size_t key);

  std::array<Known, kTickChannels + std::size(kRoleNames) + 1> known_{};
};

// The role of an event, reply or status; -1 for other messages.
int role_of(Channel channel, const std::uint8_t* bytes);

}  // namespace twinrate

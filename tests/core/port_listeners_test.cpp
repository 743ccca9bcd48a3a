// Who listens on a port: every socket but those that the processes apart made themselves.
#include "core/port_listeners.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "core/lcm_socket.hpp"

namespace twinrate::port_listeners_test {
namespace {

struct Socket {
  explicit Socket(int flags, std::uint16_t wanted = 0)
      : descriptor(socket(AF_INET, SOCK_DGRAM | flags, 0)) {
    const int on = 1;
    setsockopt(descriptor.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(wanted);
    EXPECT_EQ(bind(descriptor.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at), 0);
    socklen_t size = sizeof at;
    getsockname(descriptor.get(), reinterpret_cast<sockaddr*>(&at), &size);
    port = ntohs(at.sin_port);
  }
  FileDescriptor descriptor;
  std::uint16_t port = 0;
};

TEST(PortListeners, AreTheSocketsOfOtherProcesses) {
  const Socket own(SOCK_CLOEXEC);
  EXPECT_TRUE(PortListeners(own.port).any({}));
  EXPECT_TRUE(PortListeners(own.port).any({getppid()}));
  EXPECT_FALSE(PortListeners(own.port).any({getpid()}));
}

// A program that starts the set and listens gives the set its socket.
TEST(PortListeners, AreInheritedSocketsToo) {
  const Socket own(SOCK_CLOEXEC), inherited(0, own.port);
  EXPECT_TRUE(PortListeners(own.port).any({getpid()}));
}

TEST(PortListeners, AreSeenWhenTheyComeAndWhenTheyGo) {
  const Socket own(SOCK_CLOEXEC);
  PortListeners listeners(own.port);
  EXPECT_FALSE(listeners.any({getpid()}));
  {
    const Socket other(0, own.port);
    EXPECT_TRUE(listeners.any({getpid()}));
  }
  EXPECT_FALSE(listeners.any({getpid()}));
}

}  // namespace
}  // namespace twinrate::port_listeners_test

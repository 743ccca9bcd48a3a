// bridge/link: a pty and a UDP pair pass bytes; what cannot be opened is said in one line.
#include "bridge/link.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "core/config.hpp"
#include "core/free_udp_port.hpp"
#include "core/machine_error.hpp"

namespace twinrate::link_test {
namespace {

std::string scratch(const char* name) {
  return (std::filesystem::temp_directory_path() /
          (std::string(name) + "-" + std::to_string(getpid())))
      .string();
}

std::vector<std::uint8_t> received(Link& link, std::size_t size) {
  std::vector<std::uint8_t> all;
  for (int i = 0; i < 200 && all.size() < size; ++i) {
    const auto some = link.receive(10);
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

// Every byte value: the line is raw.
std::vector<std::uint8_t> all_bytes() {
  std::vector<std::uint8_t> bytes(256);
  for (std::size_t i = 0; i < 256; ++i) bytes[i] = static_cast<std::uint8_t>(i);
  return bytes;
}

TEST(Link, APtyPassesEveryByteBothWaysAndLeavesNoName) {
  const std::string path = scratch("twinrate-pty");
  {
    const auto device = make_pty(path);
    const auto host = open_link(path, 3000000);
    host->send(all_bytes());
    EXPECT_EQ(received(*device, 256), all_bytes());
    device->send(all_bytes());
    EXPECT_EQ(received(*host, 256), all_bytes());
    EXPECT_THROW(open_link(path, 3000000), MachineError) << "two hosts";
  }
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(path)));
}

TEST(Link, UdpAnswersTheLastSender) {
  const int port = free_udp_port();
  const auto device = listen_udp("127.0.0.1:" + std::to_string(port));
  const auto host = open_link("udp://127.0.0.1:" + std::to_string(port), 0);
  device->send(all_bytes());  // nobody has spoken yet: no error
  host->send(all_bytes());
  EXPECT_EQ(received(*device, 256), all_bytes());
  device->send(all_bytes());
  EXPECT_EQ(received(*host, 256), all_bytes());
}

TEST(Link, AClosedPortIsNoEndOfTheLine) {
  const auto host = open_link("udp://127.0.0.1:" + std::to_string(free_udp_port()), 0);
  for (int i = 0; i < 3; ++i) {
    host->send(all_bytes());
    EXPECT_TRUE(host->receive(1).empty());
  }
  EXPECT_TRUE(host->is_open());
}

TEST(Link, BadNamesAreRefused) {
  EXPECT_THROW(open_link("", 0), BadInput);
  EXPECT_THROW(open_link("udp://localhost", 0), BadInput);
  EXPECT_THROW(open_link("udp://localhost:70000", 0), BadInput);
  EXPECT_THROW(open_link("/dev/null", 115200), BadInput);
  EXPECT_THROW(open_link("/dev/no-such-line", 115200), MachineError);
  const std::string path = scratch("twinrate-baud");
  const auto device = make_pty(path);
  EXPECT_THROW(open_link(path, 12345), BadInput);
  EXPECT_THROW(make_pty("/no/such/folder/x"), BadInput);
}

}  // namespace
}  // namespace twinrate::link_test

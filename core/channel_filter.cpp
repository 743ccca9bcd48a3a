#include "core/channel_filter.hpp"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <sys/socket.h>

#include <cstring>
#include <filesystem>

namespace twinrate {
namespace {

constexpr std::uint32_t kSmallMessage = 0x4c433032;  // "LC02"
// From the UDP header on: 8 bytes of it, LCM's magic and sequence number, then the channel's name.
constexpr std::uint32_t kMagicAt = 8, kNameAt = 16 + 6;  // after "DRIVE_"

std::uint32_t first_four(const std::string& text) {
  std::uint32_t key = 0;
  for (std::size_t i = 0; i < 4; ++i)
    key = key << 8 | (i < text.size() ? static_cast<std::uint8_t>(text[i]) : 0u);
  return key;
}

}  // namespace

std::set<int> udp_sockets_on(std::uint16_t port) {
  std::set<int> sockets;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    const int fd = std::atoi(entry.path().filename().c_str());
    int type = 0;
    socklen_t size = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM) continue;
    sockaddr_in address{};
    socklen_t address_size = sizeof address;
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &address_size) != 0) continue;
    if (address.sin_family == AF_INET && ntohs(address.sin_port) == port) sockets.insert(fd);
  }
  return sockets;
}

bool filter_channels(int socket, const std::vector<std::string>& channels) {
  const auto count = static_cast<std::uint8_t>(channels.size());
  std::vector<sock_filter> program;
  program.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kMagicAt));
  program.push_back(
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kSmallMessage, 0, static_cast<std::uint8_t>(count + 2)));
  program.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kNameAt));
  for (std::uint8_t i = 0; i < count; ++i)
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, first_four(channels[i].substr(6)),
                               static_cast<std::uint8_t>(count - i), 0));
  program.push_back(BPF_STMT(BPF_RET | BPF_K, 0));           // not wanted
  program.push_back(BPF_STMT(BPF_RET | BPF_K, 0xffffffff));  // wanted, whole
  const sock_fprog filter{.len = static_cast<unsigned short>(program.size()),
                          .filter = program.data()};
  return setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

}  // namespace twinrate

#include "core/port_listeners.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace twinrate {
namespace {

// Adds the sockets on ports with this ending of an address; false if there is no such list.
bool add_sockets_on(const std::string& ending, const char* list,
                    std::vector<std::uint64_t>& inodes) {
  constexpr int kBetween = 7;  // words between the local address and the inode
  std::ifstream in(list);
  std::string line, word, local;
  if (!std::getline(in, line)) return false;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    words >> word >> local;
    for (int i = 0; i < kBetween; ++i) words >> word;
    std::uint64_t inode = 0;
    if (words >> inode && local.ends_with(ending)) inodes.push_back(inode);
  }
  return true;
}

// A process closes its own sockets when it executes another program. So an unmarked socket was
// inherited and belongs to another process.
bool is_own(pid_t pid, const std::string& descriptor) {
  std::ifstream in(fmt::format("/proc/{}/fdinfo/{}", pid, descriptor));
  for (std::string word; in >> word;)
    if (int flags = 0; word == "flags:" && in >> std::oct >> flags) return (flags & O_CLOEXEC) != 0;
  return false;
}

void add_sockets_of(pid_t pid, std::set<std::uint64_t>& inodes) {
  std::error_code error;
  const std::filesystem::path folder = fmt::format("/proc/{}/fd", pid);
  for (std::filesystem::directory_iterator file(folder, error), end; !error && file != end;
       file.increment(error)) {
    struct stat info {};
    if (stat(file->path().c_str(), &info) == 0 && S_ISSOCK(info.st_mode) &&
        is_own(pid, file->path().filename().string()))
      inodes.insert(info.st_ino);
  }
}

}  // namespace

bool PortListeners::any(const std::vector<pid_t>& apart) {
  const std::string ending = fmt::format(":{:04X}", port_);
  std::vector<std::uint64_t> sockets;
  if (!add_sockets_on(ending, "/proc/net/udp", sockets)) return true;
  add_sockets_on(ending, "/proc/net/udp6", sockets);  // a machine may have no IPv6
  const auto counts = [this](std::uint64_t inode) { return known_.count(inode) == 0; };
  if (std::none_of(sockets.begin(), sockets.end(), counts)) return false;
  known_.clear();
  for (const pid_t pid : apart) add_sockets_of(pid, known_);
  return std::any_of(sockets.begin(), sockets.end(), counts);
}

}  // namespace twinrate

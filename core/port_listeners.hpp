// Checks for listeners on a UDP port of this machine, except processes that do not count.
//
// A copy without a listener costs as much as one with a listener. If this process has no permission
// to look, a listener is assumed.
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <set>
#include <vector>

namespace twinrate {

class PortListeners {
 public:
  explicit PortListeners(std::uint16_t port) : port_(port) {}
  // `apart`: the processes whose sockets do not count.
  bool any(const std::vector<pid_t>& apart);

 private:
  std::uint16_t port_;
  std::set<std::uint64_t> known_;  // sockets (inodes) of processes that do not count
};

}  // namespace twinrate

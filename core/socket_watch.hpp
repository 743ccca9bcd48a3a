// Calls back when a socket is readable, from a thread on another CPU.
//
// For a process that sleeps on something other than its sockets. It calls again every millisecond
// until the socket is read.
#pragma once
#include <functional>
#include <thread>
#include <vector>

#include "core/lcm_socket.hpp"

namespace twinrate {

class SocketWatch {
 public:
  // `cpu` -1: any. Throws MachineError.
  SocketWatch(const std::vector<int>& sockets, int cpu, std::function<void()> on_readable);
  ~SocketWatch();
  SocketWatch(const SocketWatch&) = delete;
  SocketWatch& operator=(const SocketWatch&) = delete;

 private:
  void run(const std::vector<int>& sockets) const;

  FileDescriptor stop_;
  std::function<void()> on_readable_;
  std::thread thread_;
};

}  // namespace twinrate

#include "core/socket_watch.hpp"

#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <utility>

#include "core/machine_error.hpp"

namespace twinrate {
namespace {

constexpr auto kPeriod = std::chrono::milliseconds(1);

void move_to(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  sched_setaffinity(0, sizeof set, &set);  // of this thread; without it, calls are only slower
}

}  // namespace

SocketWatch::SocketWatch(const std::vector<int>& sockets, int cpu,
                         std::function<void()> on_readable)
    : stop_(eventfd(0, EFD_CLOEXEC)), on_readable_(std::move(on_readable)) {
  if (stop_.get() < 0) throw MachineError("eventfd: the machine gives none");
  // Signals are for the thread that waits on the bus.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this, sockets, cpu] {
    if (cpu >= 0) move_to(cpu);
    run(sockets);
  });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

SocketWatch::~SocketWatch() {
  eventfd_write(stop_.get(), 1);
  thread_.join();
}

void SocketWatch::run(const std::vector<int>& sockets) const {
  std::vector<pollfd> polled = {{.fd = stop_.get(), .events = POLLIN, .revents = 0}};
  for (const int socket : sockets) polled.push_back({.fd = socket, .events = POLLIN, .revents = 0});
  while (true) {
    if (poll(polled.data(), polled.size(), -1) < 0) continue;
    if (polled.front().revents != 0) return;
    on_readable_();
    std::this_thread::sleep_for(kPeriod);
  }
}

}  // namespace twinrate

#include "core/later_sender.hpp"

#include <pthread.h>
#include <sched.h>

#include <array>
#include <chrono>
#include <csignal>
#include <utility>

namespace twinrate {
namespace {

constexpr auto kPeriod = std::chrono::microseconds(500);

}  // namespace

LaterSender::LaterSender(const UdpmAddress& address, int cpu) : sender_(address) {
  // Signals are for the thread that waits on the bus.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this, cpu] { run(cpu); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

LaterSender::~LaterSender() {
  stop_ = true;
  thread_.join();
  send_all(waiting_);
}

void LaterSender::send(const std::string& channel, const std::uint8_t* bytes, std::size_t size) {
  const std::lock_guard lock(mutex_);
  if (waiting_.messages.size() == waiting_.count) waiting_.messages.emplace_back();
  Queue::Message& message = waiting_.messages[waiting_.count++];
  message.channel = &channel;
  message.bytes.assign(bytes, bytes + size);
}

void LaterSender::run(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  sched_setaffinity(0, sizeof set, &set);  // of this thread; without it, sending is only slower
  Queue taken;
  while (!stop_) {
    std::this_thread::sleep_for(kPeriod);
    {
      const std::lock_guard lock(mutex_);
      std::swap(taken, waiting_);
    }
    send_all(taken);
  }
}

void LaterSender::send_all(Queue& queue) {
  constexpr std::size_t kTogether = 4;
  std::array<LcmSender::Small, kTogether> list{};
  for (std::size_t i = 0; i < queue.count;) {
    std::size_t n = 0;
    for (; n < kTogether && i < queue.count; ++n, ++i)
      list[n] = {queue.messages[i].channel, queue.messages[i].bytes.data(),
                 queue.messages[i].bytes.size()};
    sender_.send_together(list.data(), n);
  }
  queue.count = 0;
}

}  // namespace twinrate

// Sends messages that nobody waits for, from a thread on another CPU.
//
// A datagram costs its sender several microseconds in the kernel, as much as a wake-up. On the CPU
// of the lock-step ring, messages for the log alone (TRUTH, REFERENCE) would lengthen every tick.
// The thread polls for messages every half millisecond; nobody wakes it.
#pragma once
#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/lcm_socket.hpp"

namespace twinrate {

class LaterSender {
 public:
  LaterSender(const UdpmAddress& address, int cpu);
  ~LaterSender();  // sends the remaining messages
  LaterSender(const LaterSender&) = delete;
  LaterSender& operator=(const LaterSender&) = delete;

  // `channel` must outlive this object.
  void send(const std::string& channel, const std::uint8_t* bytes, std::size_t size);
  std::uint64_t name() const { return sender_.name(); }

 private:
  struct Queue {
    struct Message {
      const std::string* channel;
      std::vector<std::uint8_t> bytes;
    };
    std::vector<Message>
        messages;  // the first `count` are to be sent; the others keep their memory
    std::size_t count = 0;
  };
  void run(int cpu);
  void send_all(Queue& queue);

  LcmSender sender_;
  std::mutex mutex_;
  Queue waiting_;  // guarded by mutex_
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace twinrate

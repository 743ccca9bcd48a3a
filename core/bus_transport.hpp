// Transport of a Bus: sockets of this project for udpm URLs, liblcm for others.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/channel_filter.hpp"
#include "core/lcm_socket.hpp"

namespace twinrate {

class BusTransport {
 public:
  using Handler = std::function<void(const std::uint8_t* bytes, std::size_t size)>;
  struct Outgoing {
    const std::string* channel;
    const std::uint8_t* bytes;
    std::size_t size;
    int port_offset;
    bool later = false;  // nobody waits for it
    Channel id = Channel::kStatus;
  };

  virtual ~BusTransport() = default;
  virtual void subscribe(const WantedChannel& channel, int port_offset, bool quiet,
                         Handler handler) = 0;
  // Changes `every` of a subscribed channel.
  virtual void change(const WantedChannel&) {}
  virtual void send(const Outgoing* messages, std::size_t count) = 0;
  // Passes at most one message to its handler; false if none came within `timeout_ms`.
  virtual bool handle(double timeout_ms, bool wake_for_all) = 0;
  virtual std::int64_t malformed() const { return 0; }
  // Arrival time of the message that is passed, wall clock; 0: unknown.
  virtual std::int64_t arrival_us() const { return 0; }
  // The socket that sent it, as LcmMessage::sender; 0: unknown.
  virtual std::uint64_t sender() const { return 0; }
  // The sockets on which it waits, after all subscriptions.
  virtual std::vector<int> sockets() const { return {}; }
  // It is one of this process.
  virtual bool is_own(std::uint64_t /*sender*/) const { return false; }
};

struct UdpmOptions {
  bool filter = true;
  double drain_every_ms = 0;  // as in BusOptions
  int later_cpu = -1;
  double spin_us = 0;
};
// On ports `address.port` + port_offset. Throws MachineError if the machine has no multicast.
std::unique_ptr<BusTransport> make_udpm_transport(const UdpmAddress& address,
                                                  const UdpmOptions& options);
// For every URL that liblcm supports. Throws MachineError if it cannot open the URL.
std::unique_ptr<BusTransport> make_liblcm_transport(const std::string& url);

}  // namespace twinrate

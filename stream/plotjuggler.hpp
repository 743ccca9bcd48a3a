// Messages as UDP datagrams of JSON for the "UDP Server" of PlotJuggler:
//
//   {"timestamp": 0.0123, "ESTIMATE": {"seq": 123, "omega_m_rad_s": 41.9, "x_hat[0]": 0.2, ..}}
//
// `timestamp` is the drive time in s. Texts and numbers that are not finite are left out, because
// PlotJuggler plots finite numbers. PlotJuggler reads datagrams of up to 2048 bytes; a longer
// message is sent in parts.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "export/fields.hpp"

namespace twinrate {

inline constexpr std::size_t kMaxDatagramBytes = 1400;  // within the MTU of Ethernet

// The datagrams of a message.
std::vector<std::string> plotjuggler_datagrams(Channel channel, const Layout& layout,
                                               const Sample& sample);

// A layout (Layout, Load Layout) with speeds, currents, voltages and the load estimate.
std::string plotjuggler_layout();

// Sends without waiting: a datagram that does not fit into the socket is lost and counted.
class PlotjugglerSender {
 public:
  // Throws BadInput: `host` is no IPv4 address.
  PlotjugglerSender(const std::string& host, int port);
  ~PlotjugglerSender();
  PlotjugglerSender(const PlotjugglerSender&) = delete;
  PlotjugglerSender& operator=(const PlotjugglerSender&) = delete;

  void send(Channel channel, const Layout& layout, const Sample& sample);
  std::int64_t sent() const { return sent_; }        // datagrams
  std::int64_t lost() const { return lost_; }        // the socket was full
  std::int64_t unheard() const { return unheard_; }  // refused by this host: no listener

 private:
  int socket_ = -1;
  std::int64_t sent_ = 0, lost_ = 0, unheard_ = 0;
};

}  // namespace twinrate

// The checks of `twinrate doctor`. Each returns one finding; a finding that is not ok has the
// command that fixes it.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

enum class Severity { kOk, kWarn, kFail };  // kFail: launch cannot run

struct Finding {
  std::string check;
  Severity severity = Severity::kOk;
  std::string text;
  std::string mend;  // a command; empty if ok
};

// Receive buffer requested by the logger (recv_buf_size of its URL), bytes.
inline constexpr long kWantedReceiveBuffer = 4194304;

Finding check_loopback();
Finding check_multicast_route(const std::string& address);
// Sends messages to itself over LCM on a random port of `address`, in a child process (an LCM
// object aborts when used after its failed self-test). Takes up to 5 s if no message arrives.
Finding check_lcm_loopback(const std::string& address);
Finding check_receive_buffer();
Finding check_cpus();
Finding check_clock();
Finding check_realtime_rights();
Finding check_governor();
Finding check_stock_tools();
Finding check_disk();

// The multicast address of an LCM URL "udpm://ADDRESS:PORT?..."; the default one if it has none.
std::string multicast_address_of(const std::string& url);

}  // namespace twinrate

// What `twinrate doctor` looks at: each check is one finding, and a finding that is not ok names
// its mend.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

enum class Severity { kOk, kWarn, kFail };  // kFail: launch cannot run

struct Finding {
  std::string check;
  Severity severity = Severity::kOk;
  std::string text;
  std::string mend;  // a command; empty where ok
};

// Receive buffer the logger asks for (recv_buf_size of its URL), bytes.
inline constexpr long kWantedReceiveBuffer = 4194304;

Finding check_loopback();
Finding check_multicast_route(const std::string& address);
// Publishes to itself through LCM on a private random port of `address`, in a child process (an LCM
// object whose own self-test failed aborts when used). Takes up to 5 s where nothing comes back.
Finding check_lcm_loopback(const std::string& address);
Finding check_receive_buffer();
Finding check_cpus();
Finding check_clock();
Finding check_realtime_rights();
Finding check_governor();
Finding check_stock_tools();
Finding check_disk();

// The group of an LCM URL "udpm://ADDRESS:PORT?..."; that of the default where it names none.
std::string multicast_address_of(const std::string& url);

}  // namespace twinrate

// The floor of lock-step over multicast: three processes on one CPU pass a datagram round, one system
// call a receive and one a send (run/udp_ring). A lock-step tick cannot be faster than a round.
//
//   raw_ring [STEPS [tick]]      prints rounds per second; tick: with the datagrams of a tick
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "core/report_error.hpp"
#include "core/seconds_since.hpp"
#include "run/udp_ring.hpp"

int main(int argc, char** argv) try {
  const long steps = argc > 1 ? std::atol(argv[1]) : 20'000;
  const bool tick = argc > 2 && std::string_view(argv[2]) == "tick";
  using Datagrams = twinrate::UdpRing::Datagrams;
  twinrate::UdpRing ring(0, true, tick ? Datagrams::kTick : Datagrams::kThree);
  const auto begun = std::chrono::steady_clock::now();
  for (long done = 0; done < steps;)
    if (ring.pass_round()) ++done;
  std::printf("%.0f\n", static_cast<double>(steps) / twinrate::seconds_since(begun));
  return 0;
} catch (...) {
  return twinrate::report_error("raw_ring");
}

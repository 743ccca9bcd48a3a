// A filter in the kernel that lets only wanted messages wake this process.
//
// Every LCM message on a port wakes every process on that port, wanted or not, and a wake-up costs
// more than the arithmetic of a whole tick. A classic BPF program on the receiving socket
// (SO_ATTACH_FILTER, no privilege needed) drops the others before the wake-up. If the kernel
// refuses the program, everything works, only slower (bench/results).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct WantedChannel {
  std::string name;
  // ESTIMATE: below tick `from` all, then of sequence numbers that are multiples of `every`, and any
  // that asks for a gain (kGainEveryTick).
  std::uint32_t every = 1, from = 0;
  std::int64_t session = 0;  // 0: any
  Channel channel = Channel::kStatus;
};

// Passes LCM's small messages whose channel begins with "DRIVE_" and the first four letters of one
// of `channels` after it, and whose session is that of the channel. Also passes every other
// datagram form (fragments), and a message too short for a session. False if the kernel refuses the
// program.
bool filter_channels(int socket, const std::vector<WantedChannel>& channels);

}  // namespace twinrate

// A filter in the kernel that lets only wanted messages wake this process.
//
// Every LCM message on a port wakes every process on that port, wanted or not, and a wake-up costs
// more than the whole tick's arithmetic. A classic BPF program on the receiving socket
// (SO_ATTACH_FILTER, no privilege needed) drops the others before the wake-up. Where the kernel
// refuses it everything works, only slower (bench/results).
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

// Lets through, of LCM's small messages, those whose channel begins "DRIVE_" and the first four
// letters of one of `channels` after it, and whose session is that of the channel; every other datagram
// form (fragments) passes, and a message that is too short for a session. False where the kernel
// refuses.
bool filter_channels(int socket, const std::vector<WantedChannel>& channels);

}  // namespace twinrate

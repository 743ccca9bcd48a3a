// A filter in the kernel that lets only wanted channels wake this process.
//
// Every LCM message on a port wakes every process on that port, wanted or not, and a wake-up costs
// more than the whole tick's arithmetic. A classic BPF program on the receiving socket
// (SO_ATTACH_FILTER, no privilege needed) drops the others before the wake-up. liblcm does not
// expose its socket, so it is found by its bound port. Where it is not found everything works,
// only slower (bench/results).
#pragma once
#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace twinrate {

// UDP sockets of this process that are bound to `port`.
std::set<int> udp_sockets_on(std::uint16_t port);
// Lets through, of LCM's small messages, those whose channel begins "DRIVE_" and the first four
// letters of one of `channels` after it; every other datagram form (fragments) passes. False where
// the kernel refuses.
bool filter_channels(int socket, const std::vector<std::string>& channels);

}  // namespace twinrate

// Checks whether this machine can carry LCM's multicast, and gives the remedy if not (fresh network
// namespaces, containers and unplugged laptops have no multicast route).
#pragma once
#include <string>

namespace twinrate {

// The group of kDefaultUrl.
inline constexpr const char* kDefaultMulticastAddress = "239.255.76.67";

// True if the kernel has a route to `address` (dotted IPv4); false if it is no address.
bool multicast_route_exists(const std::string& address);
bool loopback_is_up();

// Brings loopback up with its multicast flag and routes 224.0.0.0/4 over it: the commands of
// multicast_mend(), run by the program itself. Requires CAP_NET_ADMIN; changes nothing if a route
// exists. True if multicast has a route afterwards; `what_was_done` reports the change, or the
// reason of a failure.
bool try_bring_up_multicast(std::string& what_was_done);

// The two commands for a person, joined by " && ".
std::string multicast_mend();

}  // namespace twinrate

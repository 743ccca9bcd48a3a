// Carries the messages of a tick through shared memory (core/shared_ring), all others as the transport
// below it does.
#pragma once
#include <memory>
#include <string>

#include "core/bus_transport.hpp"

namespace twinrate {

struct SharedTransportOptions {
  std::string path;  // SharedMemory::path()
  Role role = Role::kPlant;
  double drain_every_ms = 0;  // as in BusOptions
  int watch_cpu = -1;         // for the thread that watches the sockets; -1: any
};
// While somebody listens (core/port_listeners), the logger sends a copy of each message of a tick
// over LCM, to `copies`, in the order of arrival. The other processes of the set send none. Throws
// BadInput and MachineError.
std::unique_ptr<BusTransport> make_shared_transport(std::unique_ptr<BusTransport> udpm,
                                                    const UdpmAddress& copies,
                                                    const SharedTransportOptions& options);

}  // namespace twinrate

// A UDP port for a process that the caller starts.
#pragma once

namespace twinrate {

// A UDP port of 127.0.0.1 that is free now. Throws MachineError.
int free_udp_port();

}  // namespace twinrate

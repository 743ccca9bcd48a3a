// Realtime settings of Linux for a process: SCHED_FIFO, and memory that is present and stays.
//
// If the machine refuses a setting (no CAP_SYS_NICE or rtprio, no memlock), the process continues
// without it. `twinrate doctor` shows how to allow it.
#pragma once
#include <string>

#include "core/channels.hpp"
#include "core/realtime_parameters.hpp"

namespace twinrate {

// Priority of a process of the set; 0: the normal scheduler. The monitor computes for seconds.
int fifo_priority(const RealtimeParameters& wanted, Role role);

bool has_realtime_policy();
// SCHED_FIFO for this thread; its children begin with the normal scheduler. A process with a
// realtime policy keeps it (chrt). Returns a text with the resulting policy; "" if it is refused,
// and at priority 0.
std::string take_fifo(int priority);
void leave_fifo();

// Touches heap and stack, keeps freed memory, and locks all present pages. Later pages are not
// locked: with a limit (RLIMIT_MEMLOCK) an allocation would fail. False if the limit is too small.
bool lock_memory();
// Whether lock_memory() would work here; locks nothing.
bool can_lock_memory();

}  // namespace twinrate

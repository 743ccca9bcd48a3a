// What a process asks of Linux for realtime: SCHED_FIFO, and memory that is there and stays.
//
// What the machine refuses (no CAP_SYS_NICE or rtprio, no memlock) is not done: the process goes on
// without it. `twinrate doctor` says how to allow it.
#pragma once
#include <string>

#include "core/channels.hpp"
#include "core/realtime_parameters.hpp"

namespace twinrate {

// Priority of a process of the set; 0: the normal scheduler. The monitor computes for seconds.
int fifo_priority(const RealtimeParameters& wanted, Role role);

bool has_realtime_policy();
// SCHED_FIFO for this thread; its children begin with the normal scheduler. A process that has a
// realtime policy already keeps it (chrt). Says what it has
// then; "" where it is refused, and at priority 0.
std::string take_fifo(int priority);
void leave_fifo();

// Touches heap and stack, keeps freed memory, and locks all pages that are there now. Pages that come
// later are not locked: with a limit (RLIMIT_MEMLOCK) an allocation would fail. False where the
// limit is too small.
bool lock_memory();
// Whether lock_memory() would work here; locks nothing.
bool can_lock_memory();

}  // namespace twinrate

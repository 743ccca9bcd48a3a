// Independent steps on all CPUs.
#pragma once
#include <cstddef>
#include <functional>
#include <initializer_list>

namespace twinrate {

// Calls f(i) for every i below `count`, on as many threads as the calling thread may use CPUs (a
// pinned process uses one), at most 8 in the process. The order is not defined, so f(i) may write
// only what belongs to i. A step may be parallel itself: it uses the CPUs that are left.
// If calls throw, the rest is left out, and the exception with the smallest i of those thrown is
// thrown again.
void for_each_index(std::size_t count, const std::function<void(std::size_t)>& f);

// The same for a few steps of different kinds.
void together(std::initializer_list<std::function<void()>> steps);

}  // namespace twinrate

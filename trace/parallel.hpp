// Independent steps on all CPUs.
#pragma once
#include <cstddef>
#include <functional>

namespace twinrate {

// Calls f(i) for every i below `count`, on as many threads as the calling thread may use CPUs (a
// pinned process uses one). The order is not defined, so f(i) may write only what belongs to i.
// If calls throw, the rest is left out, and the exception with the smallest i of those thrown is
// thrown again.
void for_each_index(std::size_t count, const std::function<void(std::size_t)>& f);

}  // namespace twinrate

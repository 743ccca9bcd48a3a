// Counts heap allocations of the whole program: operator new and the malloc family, also by Eigen
// and SUNDIALS.
#pragma once
#include <cstdint>

namespace twinrate::test {

// Allocations since the program started.
std::int64_t allocation_count();

}  // namespace twinrate::test

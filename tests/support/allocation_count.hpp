// Counts heap allocations of the whole program: operator new, malloc and its kin, so Eigen's and
// SUNDIALS' too.
#pragma once
#include <cstdint>

namespace twinrate::test {

// Allocations since the program started.
std::int64_t allocation_count();

}  // namespace twinrate::test

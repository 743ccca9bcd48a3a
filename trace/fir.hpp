// FIR filters with a few taps, for the low-pass and the whitening.
#pragma once
#include <cstddef>
#include <span>

namespace twinrate {

// y[n] = sum_j taps[j] x[first[n] + j]
void filter_at(std::span<const double> taps, const double* x, std::span<const std::size_t> first,
               double* y);
// y[n] = sum_j taps[j] x[n + j],  n = 0 .. count - 1
void filter_along(std::span<const double> taps, const double* x, std::size_t count, double* y);

}  // namespace twinrate

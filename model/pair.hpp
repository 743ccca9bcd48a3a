// Two numbers side by side: a vector of two axes, or a complex number. An operation on both is one
// instruction on every x86-64, and the same on every machine, bit for bit.
#pragma once

namespace twinrate {

using Pair [[gnu::vector_size(16)]] = double;
using PairBits [[gnu::vector_size(16)]] = unsigned long long;

inline Pair swapped(const Pair& x) {
  return Pair{x[1], x[0]};
}

}  // namespace twinrate

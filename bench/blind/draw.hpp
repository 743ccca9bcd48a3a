// A sequence of random numbers that depends on its seed alone.
#pragma once
#include <cmath>
#include <cstdint>

#include "model/frames.hpp"
#include "model/random.hpp"

namespace twinrate::blind {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : seed_(seed) {}
  double between(double lo, double hi) { return lo + (hi - lo) * uniform(seed_, 7, index_++); }
  double log_between(double lo, double hi) { return std::exp(between(std::log(lo), std::log(hi))); }
  double either(double a, double b) { return uniform(seed_, 7, index_++) < 0.5 ? a : b; }
  double signed_between(double lo, double hi) { return either(-1, 1) * between(lo, hi); }
  int whole(int lo, int hi) { return lo + static_cast<int>(between(0, hi - lo + 1 - 1e-9)); }
  bool happens(double share) { return between(0, 1) < share; }
  double phase() { return between(-kPi, kPi); }

 private:
  std::uint64_t seed_, index_ = 0;
};

}  // namespace twinrate::blind

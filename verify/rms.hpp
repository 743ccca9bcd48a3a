// Root mean square of a series of errors.
#pragma once
#include <cmath>
#include <cstddef>

#include "verify/verify.hpp"

namespace twinrate {

class Rms {
 public:
  void add(double error) {
    sum_ += error * error;
    ++count_;
  }
  double value() const { return count_ > 0 ? std::sqrt(sum_ / static_cast<double>(count_)) : 0; }

 private:
  double sum_ = 0;
  std::size_t count_ = 0;
};

inline void set(BeforeAfter& pair, bool after, double value) {
  (after ? pair.after : pair.before) = value;
}

}  // namespace twinrate

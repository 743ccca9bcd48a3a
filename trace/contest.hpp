// Compares two sets of effects over the rows of one record: which set explains which rows better.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "trace/sampler.hpp"

namespace twinrate {

struct DriveConfig;

// Residuals e_1 and e_2 under the two sets, over the whole record, with the same whitening.
class Contest {
 public:
  // `border`: the first row of the second set. The noise is that of the first set before the border
  // and of the second set from it on.
  Contest(const Record& whole, const DriveConfig& drive, const Effects& before,
          const Effects& behind, std::size_t border);
  // Compares the second set (or the first) with the other on the judging rows of [first, end).
  struct Side {
    double p = 1;     // probability that it looks better by chance; 1: it is not better
    double fall = 0;  // share of the other's error energy that it removes, whitened
  };
  Side better(bool second, std::size_t first, std::size_t end,
              const std::vector<char>& judging) const;
  // Row of the change with its range: {least, likeliest, most}.
  std::array<std::size_t, 3> moment(std::size_t first, std::size_t end) const;

 private:
  struct Term {
    std::size_t row;
    double e_1, e_2;  // squares, whitened
    double fall;      // of the square, first less second, not whitened, over the noise's
  };
  std::size_t rows_;
  Record record_;
  Equations equations_;
  Sampler sampler_;
  std::vector<Term> terms_;
};

}  // namespace twinrate

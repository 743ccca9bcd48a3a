// Two sets of effects compared over the rows of one record: which explains which rows better.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "trace/sampler.hpp"

namespace twinrate {

struct DriveConfig;

// Residuals e_1 and e_2 under the two sets, over the whole record, whitened alike.
class Contest {
 public:
  // `border`: row from which on the second set holds; the noise is that of the first before it.
  Contest(const Record& whole, const DriveConfig& drive, const Effects& before,
          const Effects& behind, std::size_t border);
  // The second (or first) against the other on rows [first, end) of those that judge.
  struct Side {
    double p = 1;     // chance that it looks better; 1: it does not
    double fall = 0;  // share of the other's error that it takes off, whitened, squares
  };
  Side better(bool second, std::size_t first, std::size_t end,
              const std::vector<char>& judging) const;
  // Rows between which the change lies, and the likeliest: {least, likeliest, most}.
  std::array<std::size_t, 3> moment(std::size_t first, std::size_t end) const;

 private:
  struct Term {
    std::size_t row;
    double e_1, e_2;  // squares, whitened
    double fall;      // from the first to the second, not whitened, in units of the noise
  };
  std::size_t rows_;
  Record record_;
  Equations equations_;
  Sampler sampler_;
  std::vector<Term> terms_;
};

}  // namespace twinrate

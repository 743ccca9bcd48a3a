// Least squares of the current that holds a rotor against sines of its angle, over several logs at
// once, each with its own offset and noise.
//
//   i_q = sum a_m sin(m theta_m) + b_m cos(m theta_m) + the same times the direction
//         + friction times the direction + offset,   all through a first-order lag, in block means
#pragma once
#include <Eigen/Core>
#include <vector>

#include "trace/hooks.hpp"
#include "trace/position_log.hpp"

namespace twinrate {

// What is fitted besides offsets.
struct Terms {
  std::vector<int> orders, ripple_orders;
  bool friction = false;
  double lag = 0;

  Eigen::Index columns() const {
    return static_cast<Eigen::Index>(2 * orders.size() + 2 * ripple_orders.size() +
                                     (friction ? 1 : 0));
  }
};

struct Prepared {
  const PositionLog* log;
  std::vector<int> direction;
  std::vector<char> ok;
  std::size_t offset = 0;  // which offset column
  double noise = 1;        // A, of a block
  double spread = 1;       // by how much correlation widens the deviations, squared
};

struct Solution {
  Eigen::VectorXd x, sigma;
  double cost = 0, variation = 0;  // weighed mean squares
  double rest = 0;                 // A, rms
  std::size_t rows = 0;
};

// Means of neighbouring rows: columns in the order of `Terms`, i_q, and the middle row of each.
struct Blocks {
  Eigen::MatrixXd X;
  Eigen::VectorXd y, row;
};
// Of so many rows that can be used.
Blocks blocks_of(const Prepared& prepared, const Terms& terms, std::size_t length);

inline constexpr std::size_t kMostBlocks = 8000;  // averages a log gives
// Rows that one mean takes.
std::size_t block_length(const PositionLog& log);
// With the noise of each log as its weight; leaves the noise found. Throws TraceStopped.
Solution solve(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
               const TraceHooks& hooks);
// Three times, each with the noise that the one before left in each log.
Solution solve_weighed(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
                       const TraceHooks& hooks);

}  // namespace twinrate

// Least squares of the current that holds a rotor on sines of its angle, over several logs at once,
// each with its own offset and noise.
//
//   i_q = sum a_m sin(m theta_m) + b_m cos(m theta_m) + the same times the direction
//         + friction times the direction + offset,   all through a first-order lag, in block means
#pragma once
#include <Eigen/Core>
#include <vector>

#include "trace/hooks.hpp"
#include "trace/position_log.hpp"

namespace twinrate {

// Terms of the fit besides the offsets.
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
  std::size_t offset = 0;  // index of the offset column
  double noise = 1;        // A, of a block
  double spread = 1;       // factor of the variances because of correlation between blocks
};

struct Solution {
  Eigen::VectorXd x, sigma;
  double cost = 0, variation = 0;  // weighted mean square; rms about the means of the logs
  double rest = 0;                 // A, rms of the residual
  std::size_t rows = 0;
};

// Means of neighbouring rows: columns in the order of `Terms`, i_q, and the middle row of each.
struct Blocks {
  Eigen::MatrixXd X;
  Eigen::VectorXd y, row;
};
// Means of `length` usable rows each.
Blocks blocks_of(const Prepared& prepared, const Terms& terms, std::size_t length);

inline constexpr std::size_t kMostBlocks = 8000;  // of a log
// Number of rows in one mean.
std::size_t block_length(const PositionLog& log);
// Weighs each log by its noise and updates that noise. Throws TraceStopped.
Solution solve(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
               const TraceHooks& hooks);
// Solves three times, each time with the noise that the last residual of each log shows.
Solution solve_weighed(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
                       const TraceHooks& hooks);

}  // namespace twinrate

// From the full rate to the tracer's rate: one low-pass for residual and regressors alike, so that
// no phase error can look like an effect.
//
//   y[n] = sum_j h[j] x[n D + j],   h symmetric (windowed sinc), D = decimation
//
// Outputs whose window touches an unusable row are left out. The remaining ones form runs of
// neighbours. A run never crosses a gap or the border between training and held-out blocks.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "trace/equations.hpp"

namespace twinrate {

// Of each row: whether the rotor moves, so that the speed determines the friction.
std::vector<char> moving_rows(const Record& record);

// Reach of the low-pass and of the response to a step of the angle: rows this close to a moment may
// show it.
inline constexpr double kReach_s = 8e-3;

struct Runs {
  std::vector<std::size_t> row;    // full-rate row at the centre of each output
  std::vector<std::size_t> start;  // index of the first output of each run, ascending
  std::vector<char> held_out;      // of each output
};

class Sampler {
 public:
  static constexpr double kPassband = 0.4;  // of the output rate
  // `rate_Hz`: wanted rate of the outputs. `held_out`: of each row, whether it belongs to a block
  // that does not train.
  Sampler(const Record& record, const std::vector<char>& torque_ok,
          const std::vector<char>& held_out, double rate_Hz = 1000);

  int decimation() const { return D_; }
  const Runs& electrical() const { return electrical_; }
  const Runs& torque() const { return torque_; }
  Eigen::VectorXd operator()(const std::vector<double>& channel, const Runs& runs) const;
  // The same from every stride()-th row from first() on, with only these rows in `channel`. This
  // suffices for a channel without noise and without content near half the record's rate.
  std::size_t stride() const { return static_cast<std::size_t>(stride_); }
  std::size_t first() const { return static_cast<std::size_t>(M_ + 1) % stride(); }
  Eigen::VectorXd sparsely(const std::vector<double>& channel, const Runs& runs) const;
  // True if a signal with `order` periods a turn stays below half the rate of those rows.
  bool slow_enough(double order) const { return order * most_turned_ * stride_ < kPi; }

 private:
  Runs runs_of(const std::vector<char>& ok, const std::vector<char>& held_out) const;
  int D_, M_, stride_ = 1;
  double most_turned_ = 0;          // rad from row to row
  std::vector<double> h_, sparse_;  // taps; those of every stride-th row
  Runs electrical_, torque_;
};

}  // namespace twinrate

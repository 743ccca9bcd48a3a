// The residual is not white even when nothing is missing (a quantised angle differentiated twice,
// current noise differentiated once). An autoregressive model of its noise makes it so:
//
//   e[n] = (y[n] - sum_{j=1..p} a_j y[n-j]) / sigma,   p the order, less at the start of a run
//
// Coefficients of all orders by Levinson's recursion from the autocovariance over the runs.
#pragma once
#include <Eigen/Core>

#include "trace/sampler.hpp"

namespace twinrate {

class Whitener {
 public:
  static constexpr int kOrder = 16;
  Whitener() = default;
  // `noise`: what is left when everything that could be missing has been fitted.
  Whitener(const Eigen::VectorXd& noise, const Runs& runs, int order = kOrder);

  Eigen::VectorXd operator()(const Eigen::VectorXd& y, const Runs& runs) const;
  double sigma() const { return sigma_.empty() ? 0 : sigma_.back(); }  // of the innovation
  double rms() const { return sigma_.empty() ? 0 : sigma_.front(); }   // of the noise itself

 private:
  std::vector<Eigen::VectorXd> taps_;  // of e, by order, the latest last
  std::vector<double> sigma_;
};

}  // namespace twinrate

// The residual is not white even if nothing is missing (a quantised angle differentiated twice,
// current noise differentiated once). An autoregressive model of its noise whitens it:
//
//   e[n] = (y[n] - sum_{j=1..p} a_j y[n-j]) / sigma,   p the order, less at the start of a run
//
// Coefficients of all orders by Levinson's recursion from the autocovariance over the runs.
//
// An autoregression of that order cannot represent an angle's noise, which after two differences
// almost vanishes at low frequencies, where friction, loads and inertia act. That noise, s of the
// angle and w beside it,
//   y[n] = n[n] - 2 n[n-1] + n[n-2] + m[n],   n of power s, m of power w, both white,
// is first reduced to its innovations, which are exact from the first value of a run on (the
// innovations algorithm: Brockwell and Davis, Time Series, 1991, 5.2). The autoregression models
// the remainder.
#pragma once
#include <Eigen/Core>

#include "trace/sampler.hpp"

namespace twinrate {

class AngleNoise {
 public:
  AngleNoise() = default;  // none: does not change its input
  explicit AngleNoise(double w_over_s);
  // The most likely one for `noise` with values T_s apart; none if that is as likely.
  static AngleNoise of(const Eigen::VectorXd& noise, const Runs& runs, double T_s);

  // Innovations, scaled to the standard deviation that they have far from a run's beginning.
  Eigen::VectorXd operator()(const Eigen::VectorXd& y, const Runs& runs) const;
  double w_over_s() const { return w_over_s_; }
  bool none() const { return after_.empty(); }

 private:
  double log_deviations(const Runs& runs) const;  // what operator() divides by, summed
  struct Step {
    double one = 0, two = 0;  // weights of the last two innovations
    double size = 1;          // deviation of the innovation over that far from the beginning
  };
  double w_over_s_ = 0;
  std::vector<Step> after_;  // by index in the run; the last one from there on
};

class Whitener {
 public:
  static constexpr int kOrder = 16;
  Whitener() = default;
  // `noise`: the residual after all candidates have been fitted.
  Whitener(const Eigen::VectorXd& noise, const Runs& runs, int order = kOrder);
  // `innovations`: output of `angle` for the noise; `rms`: of the noise.
  Whitener(const Eigen::VectorXd& innovations, const Runs& runs, AngleNoise angle, double rms);

  Eigen::VectorXd operator()(const Eigen::VectorXd& y, const Runs& runs) const;
  bool none() const { return taps_.empty(); }
  double sigma() const { return sigma_.empty() ? 0 : sigma_.back(); }  // of the innovation
  double rms() const { return rms_; }                                  // of the noise itself

 private:
  std::vector<Eigen::VectorXd> taps_;  // of e, by order, the latest last
  std::vector<double> sigma_;
  AngleNoise angle_;
  double rms_ = 0;
};

}  // namespace twinrate

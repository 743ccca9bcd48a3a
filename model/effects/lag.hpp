// A sequence of samples with a lag: delayed by a time that need not be whole samples, or through a
// first-order filter. Linear between samples, hence smooth in the time of the lag except for a kink
// at whole samples.
//
//   DelayLine   y_k = (1 - f) x_{k-n} + f x_{k-n-1},   n + f = delay/T_s; before the first sample
//               its value
//   LowPass     tau y' = x - y, exact for an x that is linear between samples:
//               y_k - x_k = a (y_{k-1} - x_{k-1}) - b (x_k - x_{k-1}),   a = exp(-T_s/tau),
//               b = (1 - a) tau/T_s
//
// `Value`: double or a fixed Eigen vector. No allocation after the constructor.
#pragma once
#include <cmath>
#include <vector>

#include "model/math.hpp"

namespace twinrate {

template <class Value>
class DelayLine {
 public:
  DelayLine(double delay, double T_s)
      : whole_(static_cast<std::size_t>(delay / T_s)),
        part_(delay / T_s - static_cast<double>(whole_)),
        past_(whole_ + 2) {}
  // By whole samples.
  explicit DelayLine(std::size_t samples) : whole_(samples), part_(0), past_(samples + 2) {}

  Value pass(const Value& x) {
    if (first_) past_.assign(past_.size(), x);
    first_ = false;
    past_[next_] = x;
    const Value& newer = past_[back(whole_)];
    const Value& older = past_[back(whole_ + 1)];
    next_ = next_ + 1 == past_.size() ? 0 : next_ + 1;
    return newer + part_ * (older - newer);
  }

 private:
  std::size_t back(std::size_t samples) const {
    return next_ >= samples ? next_ - samples : next_ + past_.size() - samples;
  }

  std::size_t whole_;
  double part_;
  std::vector<Value> past_;
  std::size_t next_ = 0;  // index of the next sample
  bool first_ = true;
};

template <class Value>
class LowPass {
 public:
  LowPass(double tau, double T_s)
      : a_(tau > 0 ? math::exp(-T_s / tau) : 0), b_(tau > 0 ? (1 - a_) * tau / T_s : 0) {}

  Value pass(const Value& x) {
    if (first_) x_ = y_ = x;
    first_ = false;
    y_ = x + a_ * (y_ - x_) - b_ * (x - x_);
    x_ = x;
    return y_;
  }

 private:
  double a_, b_;
  Value x_{}, y_{};
  bool first_ = true;
};

// The same for a value that is held over each sample, like a voltage: its mean over the sample
// after the filter,
//
//   mean_k = u_k + b (v_k - u_k),   v_{k+1} = u_k + a (v_k - u_k)
template <class Value>
class HeldLowPass {
 public:
  HeldLowPass(double tau, double T_s)
      : a_(tau > 0 ? math::exp(-T_s / tau) : 0), b_(tau > 0 ? (1 - a_) * tau / T_s : 0) {}

  Value pass(const Value& u) {
    if (first_) v_ = u;
    first_ = false;
    const Value mean = u + b_ * (v_ - u);
    v_ = u + a_ * (v_ - u);
    return mean;
  }

 private:
  double a_, b_;
  Value v_{};
  bool first_ = true;
};

}  // namespace twinrate

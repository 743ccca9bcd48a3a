// The largest variances that the background loop lets the states of a filter have.
//
// At standstill an EMF shows no angle, and a harmonic of the angle is a constant: their variances
// grow with every update, without bound. When the drive then starts, the gain is that of a filter
// without knowledge, and one sample overwrites the state. The ceiling ends the growth:
//
//   P_max_i = kMargin max(P0_ii, P_ii(omega))      P(omega): after many updates at this speed
//   P      <- D P D,  D_ii = min(1, sqrt(P_max_i/P_ii))
//
// D P D is symmetric and positive definite if P is, with the correlations of P. A covariance below
// the ceiling keeps its bits. The two states of a turning pair have the same ceiling.
//
// A filter without a covariance model or a steady state has no ceiling; nor has the form of a
// filter without voltages.
#pragma once
#include "estimator/filter.hpp"

namespace twinrate {

class CovarianceCeiling {
 public:
  // Measured with dilys2021 without current noise, 100 s at standstill, then to 400 rad/s in 50 ms:
  // the largest angle error is 4.5 deg with 10 and 100, and 6.2 deg with 1000; with 10,000 the drive
  // loses synchronism, as it does without a ceiling. With its noise the variance of the angle stays
  // below 160 times that at speed.
  static constexpr double kMargin = 1000;

  CovarianceCeiling() = default;  // no ceiling
  CovarianceCeiling(const Filter& filter, double omega_m);

  bool none() const { return P_max_.size() == 0; }
  const CovarianceModel::Vector& P_max() const { return P_max_; }
  void apply(Gain& gain) const;

 private:
  CovarianceModel::Vector P_max_;
};

}  // namespace twinrate

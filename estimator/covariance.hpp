// The measurement half of a background step, the same for every filter with a linear output y = H
// x.
//
//   K = P^- H' (H P^- H' + R)^-1;  P = (I - K H) P^- (I - K H)' + K R K'  (Joseph)  or  (I - K H)
//   P^-  (paper)
#pragma once
#include <Eigen/LU>

#include "estimator/covariance_form.hpp"
#include "model/signals.hpp"

namespace twinrate {

// The gain message of a snapshot; where it would not be finite the previous one is kept.
template <int NX, int NY>
Gain gain_of_snapshot(const Gain& previous, const Estimate& snapshot,
                      const Eigen::Matrix<double, NX, NY>& K,
                      const Eigen::Matrix<double, NX, NX>& P) {
  Gain gain = previous;
  gain.k = snapshot.k;
  gain.t_ns = snapshot.t_ns;
  gain.n_x = NX;
  gain.n_y = NY;
  if (K.allFinite() && P.allFinite()) {
    gain.K.template topLeftCorner<NX, NY>() = K;
    gain.P.template topLeftCorner<NX, NX>() = P;
  }
  return gain;
}

template <int NX, int NY>
Gain gain_from_prior(const Gain& previous, const Estimate& snapshot,
                     const Eigen::Matrix<double, NX, NX>& P_prior,
                     const Eigen::Matrix<double, NY, NX>& H, const Eigen::Matrix<double, NY, NY>& R,
                     bool joseph) {
  const Eigen::Matrix<double, NY, NY> S = H * P_prior * H.transpose() + R;
  const Eigen::Matrix<double, NX, NY> K = P_prior * H.transpose() * S.inverse();
  const Eigen::Matrix<double, NX, NX> I_KH = Eigen::Matrix<double, NX, NX>::Identity() - K * H;
  Eigen::Matrix<double, NX, NX> P = I_KH * P_prior;
  if (joseph) P = (P * I_KH.transpose() + K * R * K.transpose()).eval();
  return gain_of_snapshot<NX, NY>(previous, snapshot, K, P);
}

}  // namespace twinrate

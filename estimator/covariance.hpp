// The measurement half of a background step, for every filter with a linear output y = H x.
//
//   K = P^- H' (H P^- H' + R)^-1                                                         Dilys (17)
//   P = (I - K H) P^- (I - K H)' + K R K'              covariance = "joseph"
//   P = (I - K H) P^-                                  covariance = "paper", Dilys (15)
//
// Shapes: P^-, P NX by NX; H NY by NX; R NY by NY; K NX by NY.
// A K or P that is not finite is not taken over: the gain keeps the previous values.
#pragma once
#include <Eigen/LU>

#include "core/covariance_form.hpp"
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

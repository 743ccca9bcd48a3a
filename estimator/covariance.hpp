// The measurement half of a background step, the same for every filter with a linear output y = H
// x.
//
//   K = P^- H' (H P^- H' + R)^-1;  P = (I - K H) P^- (I - K H)' + K R K'  (Joseph)  or  (I - K H)
//   P^-  (paper)
#pragma once
#include <Eigen/LU>

#include "model/signals.hpp"

namespace twinrate {

// "sequential" takes one output after the other, for diagonal R: the same in exact arithmetic, and
// sound where R is far smaller than P^-, because it needs no determinant. "auto" takes it there,
// and Joseph elsewhere.
enum class CovarianceForm : int { kJoseph = 0, kPaper = 1, kSequential = 2, kAuto = 3 };

// R_min: smallest diagonal entry of R; P_max: largest variance of a measured state.
inline CovarianceForm resolve(CovarianceForm form, double R_min, double P_max) {
  if (form != CovarianceForm::kAuto) return form;
  return R_min < 1e-6 * P_max ? CovarianceForm::kSequential : CovarianceForm::kJoseph;
}

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

// One background step of a filter with the output y = h(x), linearised: F = df/dx, H = dh/dx.
//
//   P^- = F P F' + Q                                                                     Dilys (14)
//   K   = P^- H' (H P^- H' + R)^-1                                                       Dilys (17)
//   P   = (I - K H) P^- (I - K H)' + K R K'            covariance = "joseph"
//   P   = (I - K H) P^-                                covariance = "paper", Dilys (15)
//
// Shapes: F, P, Q NX by NX; H NY by NX; R NY by NY; K NX by NY. Q and R are diagonal.
// A K or P that is not finite is not taken over: the gain keeps the previous values.
#pragma once
#include <Eigen/LU>
#include <algorithm>
#include <span>

#include "core/covariance_form.hpp"
#include "estimator/filter.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Covariances of a filter, discrete, per background update.
template <int NX, int NY>
struct EkfTuning {
  EkfTuning(const double (&Q)[NX], const double (&R)[NY], const double (&P0)[NX],
            CovarianceForm covariance_form)
      : form(covariance_form) {
    std::copy_n(Q, NX, Q_diag);
    std::copy_n(R, NY, R_diag);
    std::copy_n(P0, NX, P0_diag);
  }
  double Q_diag[NX];   // process noise
  double R_diag[NY];   // measurement noise
  double P0_diag[NX];  // initial covariance
  CovarianceForm form;
};

// resolve() for a filter whose first states are its outputs.
inline CovarianceForm resolve(CovarianceForm form, std::span<const double> Q_diag,
                              std::span<const double> R_diag, std::span<const double> P0_diag) {
  const std::size_t n_y = R_diag.size();
  return resolve(
      form, std::ranges::min(R_diag),
      std::max(std::ranges::max(Q_diag.first(n_y)), std::ranges::max(P0_diag.first(n_y))));
}

// K = 0, P = P_0.
inline Gain first_gain(std::span<const double> P0_diag, int n_y) {
  Gain gain;
  gain.n_x = static_cast<int>(P0_diag.size());
  gain.n_y = n_y;
  std::copy(P0_diag.begin(), P0_diag.end(), gain.P.diagonal().begin());
  return gain;
}

// Makes `gain` that of a snapshot; if the result is not finite, K and P are kept.
template <class GainMatrix, class Covariance>
void set_gain(Gain& gain, const Estimate& snapshot, const GainMatrix& K, const Covariance& P) {
  gain.k = snapshot.k;
  gain.t_ns = snapshot.t_ns;
  gain.n_x = static_cast<int>(K.rows());
  gain.n_y = static_cast<int>(K.cols());
  if (K.allFinite() && P.allFinite()) {
    constexpr int n_x = GainMatrix::RowsAtCompileTime, n_y = GainMatrix::ColsAtCompileTime;
    gain.K.template topLeftCorner<n_x, n_y>(K.rows(), K.cols()) = K;
    gain.P.template topLeftCorner<n_x, n_x>(P.rows(), P.cols()) = P;
  }
}
template <class GainMatrix, class Covariance>
Gain gain_of_snapshot(const Gain& previous, const Estimate& snapshot, const GainMatrix& K,
                      const Covariance& P) {
  Gain gain = previous;
  set_gain(gain, snapshot, K, P);
  return gain;
}

// F, H and the tuning of a background step, of any size.
template <int NX, int NY>
CovarianceModel model_of(const Eigen::Matrix<double, NX, NX>& F,
                         const Eigen::Matrix<double, NY, NX>& H, const EkfTuning<NX, NY>& tuning) {
  return {F, H, Eigen::Map<const Eigen::Matrix<double, NX, 1>>(tuning.Q_diag),
          Eigen::Map<const Eigen::Matrix<double, NY, 1>>(tuning.R_diag)};
}

// The covariance at the start: P_0 if `previous` belongs to a filter of another size.
template <int NX, int NY>
Eigen::Matrix<double, NX, NX> covariance_before(const Gain& previous,
                                                const EkfTuning<NX, NY>& tuning) {
  using Diagonal = Eigen::Map<const Eigen::Matrix<double, NX, 1>>;
  if (previous.n_x != NX) return Diagonal(tuning.P0_diag).asDiagonal();
  return previous.P.template topLeftCorner<NX, NX>();
}

template <int NX, int NY>
Gain covariance_step(const Gain& previous, const Estimate& snapshot,
                     const Eigen::Matrix<double, NX, NX>& F, const Eigen::Matrix<double, NY, NX>& H,
                     const EkfTuning<NX, NY>& tuning) {
  using Covariance = Eigen::Matrix<double, NX, NX>;
  using OutputCovariance = Eigen::Matrix<double, NY, NY>;
  const Covariance Q = Eigen::Map<const Eigen::Matrix<double, NX, 1>>(tuning.Q_diag).asDiagonal();
  const OutputCovariance R =
      Eigen::Map<const Eigen::Matrix<double, NY, 1>>(tuning.R_diag).asDiagonal();
  const Covariance P_prior = F * covariance_before(previous, tuning) * F.transpose() + Q;
  const OutputCovariance S = H * P_prior * H.transpose() + R;
  const Eigen::Matrix<double, NX, NY> K = P_prior * H.transpose() * S.inverse();
  const Covariance I_KH = Covariance::Identity() - K * H;
  Covariance P = I_KH * P_prior;
  if (tuning.form != CovarianceForm::kPaper)
    P = (P * I_KH.transpose() + K * R * K.transpose()).eval();
  return gain_of_snapshot(previous, snapshot, K, P);
}

}  // namespace twinrate

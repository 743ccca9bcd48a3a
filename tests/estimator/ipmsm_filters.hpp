// The salient machine of the filter tests, its three filters, and samples of it at a constant
// speed.
#pragma once
#include "estimator/backemf_printed.hpp"
#include "estimator/dq_ekf.hpp"
#include "estimator/eemf.hpp"
#include "model/random.hpp"

namespace twinrate::ipmsm_filters_test {

inline constexpr double kTs = 1e-4;

inline MachineParameters ipmsm() {
  return {.R_s = 11, .L_d = 0.05635, .L_q = 0.133, .psi_f = 0.285, .J = 1e-4, .B = 2e-4, .n_p = 2};
}

inline DqEkf dq_ekf(Prediction prediction, KnownStart start = {}) {
  return {ipmsm(), {}, prediction, CovarianceForm::kJoseph, kTs, start};
}
inline Eemf eemf(Prediction prediction, Rotation rotation = Rotation::kExact,
                 KnownStart start = {}) {
  EemfParameters tuning;
  tuning.rotation = rotation;
  return {ipmsm(), tuning, prediction, CovarianceForm::kJoseph, kTs, start};
}
inline BackEmfPrinted printed(Prediction prediction, Rotation rotation = Rotation::kExact,
                              KnownStart start = {}) {
  BackEmfParameters tuning;
  tuning.rotation = rotation;
  return {ipmsm(), tuning, prediction, CovarianceForm::kJoseph, kTs, start};
}

// A drive at constant speed with noise on top.
inline Measurement sample(std::int64_t k) {
  const auto i = static_cast<std::uint64_t>(k);
  const double theta_e = 200 * kTs * static_cast<double>(k);
  Measurement s{.k = k};
  const Vec2 y = inverse_park({-0.4, 1.2}, theta_e) + 0.01 * Vec2(normal(4, 0, i), normal(4, 1, i));
  s.i_abc = inverse_clarke(y);
  s.u_alphabeta = inverse_park({-36, 70}, theta_e - 100 * kTs) + Vec2(normal(4, 2, i), 0);
  return s;
}

}  // namespace twinrate::ipmsm_filters_test

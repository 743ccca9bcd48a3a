#include "estimator/covariance_ceiling.hpp"

#include <algorithm>
#include <cmath>

#include "estimator/gain_schedule.hpp"

namespace twinrate {

CovarianceCeiling::CovarianceCeiling(const Filter& filter, double omega_m) {
  const auto P = settled_covariance(filter, omega_m);
  if (!P) return;
  const Gain first = filter.initial_gain();
  P_max_ = kMargin * P->diagonal().cwiseMax(first.P.diagonal().head(first.n_x));
  for (int pair = 0; pair < filter.turning_pairs(); ++pair)
    P_max_.segment<2>(2 * pair).setConstant(P_max_.segment<2>(2 * pair).maxCoeff());
}

void CovarianceCeiling::apply(Gain& gain) const {
  if (gain.n_x != P_max_.size()) return;
  for (int i = 0; i < gain.n_x; ++i) {
    if (!(gain.P(i, i) > P_max_[i])) continue;
    const double d = std::sqrt(P_max_[i] / gain.P(i, i));
    gain.P.row(i).head(gain.n_x) *= d;
    gain.P.col(i).head(gain.n_x) *= d;
    gain.P(i, i) = P_max_[i];
  }
}

}  // namespace twinrate

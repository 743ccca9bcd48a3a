// Tails of distributions, for evidence.
#pragma once
#include <vector>

#include "trace/sampler.hpp"

namespace twinrate {

// P(chi-square with k degrees of freedom > x); 0 where it is below 1e-300.
double chi_square_tail(double x, double k);
// Ljung-Box over the runs, 20 lags: the p-value of "white".
double whiteness_p_value(const Eigen::VectorXd& e, const Runs& runs);

}  // namespace twinrate

// Tails of distributions, for evidence.
#pragma once
#include <vector>

#include "trace/sampler.hpp"

namespace twinrate {

// P(chi-square with k degrees of freedom > x); 0 where it is below 1e-300.
double chi_square_tail(double x, double k);
// Wilcoxon's signed-rank test: the probability that votes with no preference for either side lie so
// far above 0; 1 for none.
double signed_rank_tail(const std::vector<double>& votes);
// Ljung-Box over the runs: the p-value of "white". `fitted`: coefficients of the autoregression
// whose innovations they are, where it was made from the same rows.
double whiteness_p_value(const Eigen::VectorXd& e, const Runs& runs, int lags = 20, int fitted = 0);

}  // namespace twinrate

// Tail probabilities of distributions.
#pragma once
#include <vector>

#include "trace/sampler.hpp"

namespace twinrate {

// P(chi-square with k degrees of freedom > x); 0 if it is below 1e-300.
double chi_square_tail(double x, double k);
// Wilcoxon's signed-rank test: the probability that votes without a preference are this far above
// 0; 1 without votes.
double signed_rank_tail(const std::vector<double>& votes);
// Ljung-Box test over the runs: p-value of the hypothesis that e is white. `fitted`: coefficients
// of the autoregression of which e are the innovations, if it was fitted to the same rows.
double whiteness_p_value(const Eigen::VectorXd& e, const Runs& runs, int lags = 20, int fitted = 0);

}  // namespace twinrate

// A stop-gap for structure that no effect explains: the residual as a table over one variable.
//
//   c(x) = sum_j value_j hat_j(x),   hats over 25 knots (a periodic 36 over a turn; two directions)
//
// fitted by least squares to the residual of the traced model on the training rows. It describes
// the residual without naming a cause. Its benefit is measured on rows that it has not seen.
#pragma once
#include "trace/result.hpp"

namespace twinrate {

// For each structure of result.unexplained over a variable that can recur (not time). Lines have a
// stop-gap of their own. `result` must have its structures and series already.
std::vector<CorrectionTable> corrections_of(const TraceResult& result);
// The correction's variable at row i of a series of its channel.
double regressor_at(const TraceSeries& series, std::size_t i, const CorrectionTable& correction);

}  // namespace twinrate

// Least squares within bounds, with the covariance of the parameters, by Ceres: the part `ceres`
// (core/load_part.hpp).
#pragma once
#include <functional>
#include <vector>

namespace twinrate {

struct BoundedProblem {
  std::function<void(const double* x, double* residual)> residual;
  int residuals = 0;
  std::vector<double> lo, hi;  // of each parameter
  int max_iterations = 0;
  double function_tolerance = 0;
};

struct BoundedFit {
  double cost = 0;                 // half of the sum of squares
  std::vector<double> covariance;  // of unit variance, row by row; empty: not computable
};

// Takes `x` from its start to the minimum.
using FitWithinBounds = void(const BoundedProblem& problem, std::vector<double>& x,
                             BoundedFit& fit);

}  // namespace twinrate

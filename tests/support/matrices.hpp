// Checks of matrices: numerical Jacobians and covariances.
#pragma once
#include <Eigen/Core>

#include "model/linear_algebra.hpp"

namespace twinrate::test {

// df/dx by central differences, one column a state, each with its own step.
template <class F>
Eigen::MatrixXd numerical_jacobian(const F& f, const Eigen::VectorXd& x,
                                   const Eigen::VectorXd& step) {
  Eigen::MatrixXd J(f(x).size(), x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    Eigen::VectorXd ahead = x, behind = x;
    ahead[i] += step[i];
    behind[i] -= step[i];
    J.col(i) = (f(ahead) - f(behind)) / (2 * step[i]);
  }
  return J;
}

inline double asymmetry(const Eigen::MatrixXd& P) {
  return (P - P.transpose()).cwiseAbs().maxCoeff() / P.cwiseAbs().maxCoeff();
}

inline double smallest_eigenvalue(const Eigen::MatrixXd& P) {
  return linear::symmetric_eigen(0.5 * (P + P.transpose())).values[0];
}

}  // namespace twinrate::test

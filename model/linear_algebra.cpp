#include "model/linear_algebra.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace twinrate::linear {

MatrixXd inverse(const MatrixXd& A) {
  return A.inverse();
}

MatrixXd solve(const MatrixXd& A, const MatrixXd& B) {
  return A.partialPivLu().solve(B);
}

MatrixXd solve_symmetric(const MatrixXd& S, const MatrixXd& B) {
  const Eigen::LDLT<MatrixXd> ldlt(S);
  if (B.cols() == 1) return ldlt.solve(B.col(0));  // in Eigen's order for vectors
  return ldlt.solve(B);
}

Eigen::VectorXcd eigenvalues(const MatrixXd& A) {
  return A.eigenvalues();
}

}  // namespace twinrate::linear

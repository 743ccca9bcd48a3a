#include "model/linear_algebra.hpp"

#include <Eigen/Dense>

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

VectorXd least_squares(const MatrixXd& A, const VectorXd& y) {
  return A.colPivHouseholderQr().solve(y);
}

MatrixXd pseudo_inverse(const MatrixXd& A) {
  return A.completeOrthogonalDecomposition().pseudoInverse();
}

Eigen::VectorXcd eigenvalues(const MatrixXd& A) {
  return A.eigenvalues();
}

SymmetricEigen symmetric_eigen(const MatrixXd& S) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(S);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

}  // namespace twinrate::linear

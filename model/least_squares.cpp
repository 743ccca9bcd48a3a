#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include "model/linear_algebra.hpp"

namespace twinrate::linear {

VectorXd least_squares(const MatrixXd& A, const VectorXd& y) {
  return A.colPivHouseholderQr().solve(y);
}

MatrixXd pseudo_inverse(const MatrixXd& A) {
  return A.completeOrthogonalDecomposition().pseudoInverse();
}

SymmetricEigen symmetric_eigen(const MatrixXd& S) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(S);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

}  // namespace twinrate::linear

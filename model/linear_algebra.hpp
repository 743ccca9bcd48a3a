// Decompositions of dense matrices, compiled once: Eigen's are slow to compile wherever they are
// used.
//
// A singular matrix is not an error: the result is not finite.
#pragma once
#include <Eigen/Core>

namespace twinrate::linear {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A^-1 and A^-1 B by LU with partial pivoting.
MatrixXd inverse(const MatrixXd& A);
MatrixXd solve(const MatrixXd& A, const MatrixXd& B);

// S^-1 B of a symmetric S, whose lower triangle alone is read, by L D L'.
MatrixXd solve_symmetric(const MatrixXd& S, const MatrixXd& B);

// The x of smallest |A x - y|, by QR with pivoted columns.
VectorXd least_squares(const MatrixXd& A, const VectorXd& y);

// Moore and Penrose's, of a matrix of any rank.
MatrixXd pseudo_inverse(const MatrixXd& A);

Eigen::VectorXcd eigenvalues(const MatrixXd& A);

// S = vectors diag(values) vectors' of a symmetric S; values ascend.
struct SymmetricEigen {
  VectorXd values;
  MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const MatrixXd& S);

}  // namespace twinrate::linear

// The matrix exponential, compiled once: Eigen's is slow to compile wherever it is included.
#pragma once
#include <Eigen/Core>

namespace twinrate {

// Up to 16 by 16 on the stack: no allocation.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 16, 16>;

SmallMatrix matrix_exponential(const SmallMatrix& A);

}  // namespace twinrate

#include "model/matrix_exponential.hpp"

#include <Eigen/LU>
#include <unsupported/Eigen/MatrixFunctions>

namespace twinrate {

SmallMatrix matrix_exponential(const SmallMatrix& A) {
  return A.exp();
}

}  // namespace twinrate

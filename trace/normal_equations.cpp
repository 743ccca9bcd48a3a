#include <algorithm>
#include <cmath>

#include "model/linear_algebra.hpp"
#include "trace/dictionary.hpp"

namespace twinrate {
namespace {

constexpr double kRidge = 1e-8;

// D A D with ones on the diagonal; rows left out are those of the identity, also where A is not
// finite: a column may have no value (a zone of zero current has no derivative).
Eigen::MatrixXd scaled(const Eigen::MatrixXd& A, const std::vector<char>& use,
                       Eigen::VectorXd& scale) {
  const Eigen::Index n = A.rows();
  scale = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i)
    if (use[static_cast<std::size_t>(i)]) scale[i] = 1 / std::sqrt(A(i, i));
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      if (scale[i] != 0 && scale[j] != 0) S(i, j) = scale[i] * A(i, j) * scale[j];
  for (Eigen::Index i = 0; i < n; ++i) S(i, i) = 1 + kRidge;
  return S;
}

}  // namespace

std::vector<char> NormalEquations::usable(double rows) const {
  std::vector<char> use(static_cast<std::size_t>(b.size()));
  for (Eigen::Index i = 0; i < b.size(); ++i)
    use[static_cast<std::size_t>(i)] = A(i, i) > 1e-12 * rows && A(i, i) > noise[i];
  return use;
}

Eigen::Index NormalEquations::spurious(const std::vector<char>& use) const {
  constexpr double kOwn = 1e-5;  // share of its energy that the others do not explain
  constexpr double kSame = 0.1;  // of the least: closer shares differ only by rounding
  const Eigen::VectorXd inverse = this->inverse(use).diagonal();
  const auto own = [&](Eigen::Index i) { return 1 / (inverse[i] * A(i, i)); };
  Eigen::Index found = -1;
  double least = kOwn;
  for (Eigen::Index i = 0; i < b.size(); ++i)
    if (use[static_cast<std::size_t>(i)] && own(i) < least) least = own(i), found = i;
  // Two proportional columns have equal shares. A candidate comes after the members.
  const double same = std::min(kOwn, least + kSame * std::abs(least));
  for (Eigen::Index i = found + 1; found >= 0 && i < b.size(); ++i)
    if (use[static_cast<std::size_t>(i)] && own(i) < same) found = i;
  return found;
}

Eigen::VectorXd NormalEquations::solve(const std::vector<char>& use) const {
  Eigen::VectorXd scale;
  const Eigen::MatrixXd S = scaled(A, use, scale);
  const Eigen::VectorXd scaled_b =
      (scale.array() != 0).select(scale.cwiseProduct(b), Eigen::VectorXd::Zero(b.size()));
  return scale.asDiagonal() * linear::solve_symmetric(S, scaled_b);
}

Eigen::MatrixXd NormalEquations::inverse(const std::vector<char>& use) const {
  Eigen::VectorXd scale;
  const Eigen::MatrixXd S = scaled(A, use, scale);
  return scale.asDiagonal() * linear::solve_symmetric(S, scale.asDiagonal().toDenseMatrix());
}

}  // namespace twinrate

#include "identify/segmented_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cassert>
#include <cmath>
#include <limits>

namespace twinrate {
namespace {

Eigen::VectorXd solved(const Eigen::MatrixXd& N, const Eigen::VectorXd& b) {
  // Scales the columns to unit length: the parameters have different units.
  const Eigen::VectorXd scale =
      N.diagonal().cwiseSqrt().unaryExpr([](double s) { return s > 0 ? 1 / s : 1.0; });
  const Eigen::MatrixXd scaled = scale.asDiagonal() * N * scale.asDiagonal();
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * b);
}

}  // namespace

void SegmentedFit::add(const Eigen::MatrixXd& local, const Eigen::MatrixXd& shared,
                       const Eigen::VectorXd& y) {
  assert(shared.cols() == shared_ && local.rows() == y.size() && shared.rows() == y.size());
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(local);
  Eigen::MatrixXd both(y.size(), shared_ + 1);
  both << shared, y;
  both.applyOnTheLeft(qr.householderQ().adjoint());
  const Eigen::Index rows = y.size() - local.cols();
  const auto S = both.bottomRows(rows).leftCols(shared_);
  const auto rest = both.bottomRows(rows).col(shared_);
  parts_.push_back(
      {S.transpose() * S, S.transpose() * rest, rest.squaredNorm(), y.size() - local.cols()});
}

SegmentedFit::Solution SegmentedFit::solve(const std::vector<Eigen::Index>& used) const {
  const auto n = static_cast<Eigen::Index>(used.size());
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
  double yy = 0;
  Eigen::Index rows = 0;
  std::vector<Part> parts;
  for (const Part& part : parts_) {
    parts.push_back({part.N(used, used), part.b(used), part.yy, part.rows});
    N += parts.back().N, b += parts.back().b, yy += part.yy, rows += part.rows;
  }
  const Eigen::VectorXd x = solved(N, b);
  Solution solution{Eigen::VectorXd::Zero(shared_), Eigen::VectorXd::Zero(shared_), 0};
  const double rest = std::max(0.0, yy - 2 * x.dot(b) + x.dot(N * x));
  solution.rms = rows > n ? std::sqrt(rest / static_cast<double>(rows - n)) : 0;
  const auto s = static_cast<double>(parts.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(n), square = mean;
  std::vector<Eigen::VectorXd> without;
  for (const Part& part : parts) without.push_back(solved(N - part.N, b - part.b));
  for (const auto& w : without) mean += w / s;
  for (const auto& w : without) square += (w - mean).cwiseAbs2();
  for (Eigen::Index i = 0; i < n; ++i) {
    solution.x[used[static_cast<std::size_t>(i)]] = x[i];
    solution.sigma[used[static_cast<std::size_t>(i)]] =
        s < 3 ? std::numeric_limits<double>::infinity() : std::sqrt((s - 1) / s * square[i]);
  }
  return solution;
}

}  // namespace twinrate

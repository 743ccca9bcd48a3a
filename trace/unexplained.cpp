#include "trace/unexplained.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "trace/parallel.hpp"

namespace twinrate {
namespace {

constexpr Eigen::Index kMostRows = 4000, kPiece = 100;
constexpr double kRidge = 1e-8;
constexpr double kMore = 1.1;  // of a piece: the columns have added to it

// Pieces spread over the whole record, in sequence.
Eigen::VectorXd gathered(const Eigen::VectorXd& v) {
  const Eigen::Index every = std::max<Eigen::Index>(1, v.size() / kMostRows);
  std::vector<Eigen::Index> firsts;
  for (Eigen::Index first = 0; first + kPiece <= v.size(); first += every * kPiece)
    firsts.push_back(first);
  Eigen::VectorXd out(static_cast<Eigen::Index>(firsts.size()) * kPiece);
  for (std::size_t i = 0; i < firsts.size(); ++i)
    out.segment(static_cast<Eigen::Index>(i) * kPiece, kPiece) = v.segment(firsts[i], kPiece);
  return out;
}

}  // namespace

Eigen::VectorXd Unexplained::weighed(const Eigen::VectorXd& pieces) const {
  if (!noise_) return pieces;
  Runs runs;
  runs.row.resize(static_cast<std::size_t>(pieces.size()));
  for (std::size_t first = 0; first < runs.row.size(); first += kPiece) runs.start.push_back(first);
  return (*noise_)(pieces, runs);
}

void Unexplained::look_at(const Columns& x) {
  x_ = x;
  if (x.empty()) return;
  const auto p = static_cast<Eigen::Index>(x.size());
  const Eigen::Index rows = gathered(*x[0]).size();
  if (X_.rows() != rows || X_.cols() != p) {
    X_ = Eigen::MatrixXd::Zero(rows, p);
    scale_ = Eigen::VectorXd::Zero(p);
    G_ = Eigen::MatrixXd::Zero(p, p);
  }
  std::vector<char> changed(x.size(), 0);
  for_each_index(x.size(), [&](std::size_t i) {
    const auto c = static_cast<Eigen::Index>(i);
    const Eigen::VectorXd column = weighed(gathered(*x[i]));
    const double norm = column.norm(), scale = norm > 0 ? 1 / norm : 0;
    const Eigen::VectorXd unit = scale * column;
    if (scale == scale_[c] && unit == X_.col(c)) return;
    X_.col(c) = unit;
    scale_[c] = scale;
    changed[i] = 1;
  });
  std::vector<Eigen::Index> anew;
  for (Eigen::Index c = 0; c < p; ++c)
    if (changed[static_cast<std::size_t>(c)]) anew.push_back(c);
  if (2 * anew.size() > x.size()) {
    G_.setZero();
    G_.selfadjointView<Eigen::Lower>().rankUpdate(X_.transpose());
    G_.triangularView<Eigen::StrictlyUpper>() = G_.transpose();
  } else {
    for (Eigen::Index c : anew) {
      G_.col(c) = X_.transpose() * X_.col(c);
      G_.row(c) = G_.col(c).transpose();
    }
  }
}

Eigen::VectorXd Unexplained::operator()(const Eigen::VectorXd& y, Eigen::Index count) const {
  const Eigen::Index n = X_.rows();
  if (!y.size() || count == 0 || y.size() < 3 * count || n < 3 * count) return y;
  Eigen::MatrixXd G = G_.topLeftCorner(count, count);
  G.diagonal().array() += kRidge;
  const Eigen::VectorXd c =
      scale_.head(count).asDiagonal() * G.selfadjointView<Eigen::Lower>().ldlt().solve(
                                            X_.leftCols(count).transpose() * weighed(gathered(y)));
  Eigen::VectorXd left = y;
  for (Eigen::Index i = 0; i < count; ++i) left -= c[i] * *x_[static_cast<std::size_t>(i)];
  // Between the fitted pieces the columns are not constrained.
  const Eigen::VectorXd weighed_left = weighed(left), weighed_y = weighed(y);
  for (Eigen::Index first = 0; first < y.size(); first += kPiece) {
    const Eigen::Index rows = std::min(kPiece, y.size() - first);
    if (weighed_left.segment(first, rows).norm() > kMore * weighed_y.segment(first, rows).norm())
      left.segment(first, rows) = y.segment(first, rows);
  }
  // Columns reduce the noise of the fitted rows and add to that of the others.
  const double share = static_cast<double>(count) / static_cast<double>(n),
               fitted = static_cast<double>(n) / static_cast<double>(y.size());
  return left / std::sqrt(1 + share * (1 - 2 * std::min(1.0, fitted)));
}

}  // namespace twinrate

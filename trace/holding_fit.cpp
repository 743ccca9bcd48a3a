#include "trace/holding_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace twinrate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Averages of `length` neighbouring usable rows.
VectorXd block_means(const std::vector<double>& x, const std::vector<char>& ok,
                     std::size_t length) {
  std::vector<double> means;
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (!ok[k]) {
      sum = 0, count = 0;
      continue;
    }
    sum += x[k];
    if (++count == length) {
      means.push_back(sum / static_cast<double>(length));
      sum = 0, count = 0;
    }
  }
  return Eigen::Map<const VectorXd>(means.data(), static_cast<Index>(means.size()));
}

// sin and cos of order theta_m at every row; the next order follows by one rotation.
class Turning {
 public:
  explicit Turning(const std::vector<double>& theta_m) : theta_m_(theta_m) {
    for (const double angle : theta_m) {
      s_1_.push_back(std::sin(angle));
      c_1_.push_back(std::cos(angle));
    }
    s_.assign(theta_m.size(), 0);
    c_.assign(theta_m.size(), 1);
  }
  void go_to(int order) {
    const bool next = order == order_ + 1 && order % 64 != 0;  // rounding errors do not build up
    for (std::size_t k = 0; k < theta_m_.size(); ++k) {
      const double s = s_[k], c = c_[k];
      s_[k] = next ? s * c_1_[k] + c * s_1_[k] : std::sin(order * theta_m_[k]);
      c_[k] = next ? c * c_1_[k] - s * s_1_[k] : std::cos(order * theta_m_[k]);
    }
    order_ = order;
  }
  const std::vector<double>& s() const { return s_; }
  const std::vector<double>& c() const { return c_; }

 private:
  const std::vector<double>& theta_m_;
  std::vector<double> s_1_, c_1_, s_, c_;
  int order_ = 0;
};

}  // namespace

Blocks blocks_of(const Prepared& p, const Terms& terms, std::size_t length) {
  const PositionLog& log = *p.log;
  const auto averaged = [&](const std::vector<double>& x) {
    return block_means(log.has_time() ? low_pass(log.t, x, terms.lag) : x, p.ok, length);
  };
  Blocks b;
  b.y = block_means(log.i_q, p.ok, length);
  std::vector<double> row(log.size());
  std::iota(row.begin(), row.end(), 0.0);
  b.row = block_means(row, p.ok, length);
  b.X.resize(b.y.size(), terms.columns());
  Index j = 0;
  Turning turning(log.theta_m);
  std::vector<double> signed_s, signed_c;
  const auto add = [&](int order, bool with_direction) {
    turning.go_to(order);
    if (!with_direction) {
      b.X.col(j++) = averaged(turning.s());
      b.X.col(j++) = averaged(turning.c());
      return;
    }
    signed_s = turning.s();
    signed_c = turning.c();
    for (std::size_t k = 0; k < log.size(); ++k) {
      signed_s[k] *= p.direction[k];
      signed_c[k] *= p.direction[k];
    }
    b.X.col(j++) = averaged(signed_s);
    b.X.col(j++) = averaged(signed_c);
  };
  for (const int order : terms.orders) add(order, false);
  for (const int order : terms.ripple_orders) add(order, true);
  if (terms.friction) b.X.col(j) = averaged({p.direction.begin(), p.direction.end()});
  return b;
}

namespace {

// The block means of all logs and their normal equations, for any weights.
struct System {
  Index columns = 0;
  std::vector<Blocks> blocks;
  std::vector<MatrixXd> normal;
  std::vector<VectorXd> right;
};

// The offsets are the last columns.
System system_of(const std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
                 const TraceHooks& hooks) {
  System system;
  const Index n = system.columns = terms.columns() + static_cast<Index>(offsets);
  for (const Prepared& p : logs) {
    hooks.checkpoint();
    Blocks b = blocks_of(p, terms, block_length(*p.log));
    b.X.conservativeResize(Eigen::NoChange, n);
    b.X.rightCols(static_cast<Index>(offsets)).setZero();
    b.X.col(terms.columns() + static_cast<Index>(p.offset)).setOnes();
    MatrixXd part = MatrixXd::Zero(n, n);
    part.selfadjointView<Eigen::Lower>().rankUpdate(b.X.transpose());
    system.normal.push_back(part.selfadjointView<Eigen::Lower>());
    system.right.push_back(b.X.transpose() * b.y);
    system.blocks.push_back(std::move(b));
  }
  return system;
}

// Least squares with the noise of each log as its weight; updates that noise.
Solution solve(std::vector<Prepared>& logs, const System& system) {
  const Index n = system.columns;
  MatrixXd normal = MatrixXd::Zero(n, n), widened = MatrixXd::Zero(n, n);
  VectorXd right = VectorXd::Zero(n);
  for (std::size_t i = 0; i < logs.size(); ++i) {
    const double weight = 1 / (logs[i].noise * logs[i].noise);
    normal += weight * system.normal[i];
    widened += weight * logs[i].spread * system.normal[i];
    right += weight * system.right[i];
  }
  normal.diagonal() *= 1 + 1e-9;
  const Eigen::LDLT<MatrixXd> factor(normal);
  Solution s;
  s.x = factor.solve(right);
  double squares = 0;
  for (std::size_t i = 0; i < logs.size(); ++i) {
    const Blocks& b = system.blocks[i];
    const VectorXd rest = b.y - b.X * s.x;
    s.cost += rest.squaredNorm() / (logs[i].noise * logs[i].noise);
    s.variation += (b.y.array() - b.y.mean()).matrix().squaredNorm();
    squares += rest.squaredNorm();
    s.rows += static_cast<std::size_t>(rest.size());
    const Index m = rest.size();
    const double rows = std::max<double>(1, static_cast<double>(m));
    logs[i].noise = std::max(rest.norm() / std::sqrt(rows), 1e-9);
    const double r = m < 3 ? 0 : rest.head(m - 1).dot(rest.tail(m - 1)) / rest.squaredNorm();
    const double bounded = std::clamp(r, 0.0, 0.98);
    logs[i].spread = (1 + bounded) / (1 - bounded);
  }
  s.cost /= static_cast<double>(s.rows);
  s.rest = std::sqrt(squares / static_cast<double>(s.rows));
  s.variation = std::sqrt(s.variation / static_cast<double>(s.rows));
  const MatrixXd inverse = factor.solve(MatrixXd::Identity(n, n));
  s.sigma = inverse.cwiseProduct(inverse * widened).rowwise().sum().cwiseMax(0).cwiseSqrt();
  return s;
}

}  // namespace

std::size_t block_length(const PositionLog& log) {
  return std::max<std::size_t>(1, log.size() / kMostBlocks);
}

Solution solve(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
               const TraceHooks& hooks) {
  return solve(logs, system_of(logs, terms, offsets, hooks));
}

Solution solve_weighed(std::vector<Prepared>& logs, const Terms& terms, std::size_t offsets,
                       const TraceHooks& hooks) {
  for (Prepared& p : logs) p.noise = p.spread = 1;
  const System system = system_of(logs, terms, offsets, hooks);
  solve(logs, system);
  solve(logs, system);
  return solve(logs, system);
}

}  // namespace twinrate

#include "trace/speed_against_angle.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kWindow = 101, kEnd = 5, kEvery = 16;  // rows; kEnd: a mean at either end
constexpr std::size_t kFewest = 30;                          // windows
constexpr double kHalfTurn = kTwoPi / 2, kSameTurn = 0.3;    // rad

}  // namespace

void SpeedAgainstAngle::add(double t, double theta_m, double omega_m, double T_s) {
  if (!std::isfinite(theta_m) || !std::isfinite(omega_m)) return;
  if (!rows_.empty() && !(t > rows_.back().t && t - rows_.back().t < 2.5 * T_s)) rows_.clear();
  Row row{t, theta_m, omega_m, 0, 0};
  if (!rows_.empty()) {
    const Row& before = rows_.back();
    const double step = wrap_pi(theta_m - before.theta_m),
                 integral = 0.5 * (t - before.t) * (omega_m + before.omega_m);
    row.turned = before.turned + step;
    row.integral = before.integral + integral;
    // An angle that counts turns shows a step of any size.
    const double more = integral - step, counted = integral - (theta_m - before.theta_m);
    hidden_ += std::min(std::abs(more), std::abs(counted)) > kHalfTurn &&
               std::abs(wrap_pi(more)) < kSameTurn;
    steps_ += std::abs(integral) > kSameTurn;
  }
  rows_.push_back(row);
  ++since_last_;
  if (rows_.size() > kWindow) rows_.pop_front();
  if (rows_.size() < kWindow || since_last_ < kEvery) return;
  since_last_ = 0;
  ++windows_;
  // From the middle of one end to the middle of the other.
  const Row &a = rows_[kEnd / 2], &b = rows_[kWindow - 1 - kEnd / 2];
  double gained = 0;
  for (std::size_t j = 0; j < kEnd; ++j)
    gained += (rows_[kWindow - kEnd + j].omega_m - rows_[j].omega_m) / kEnd;
  const Eigen::Vector3d z(gained, b.integral - a.integral, b.turned - a.turned);
  products_ += z * z.transpose();
}

SpeedAgainstAngle::Difference SpeedAgainstAngle::difference() const {
  constexpr double kPlain = 0.5;  // of the residual of the integral: a lag explains more
  constexpr double kSigmas = 10, kSameScale = 0.01;
  Difference d;
  if (windows_ >= kFewest)
    d.hidden_turns =
        static_cast<double>(hidden_) / static_cast<double>(std::max<std::size_t>(1, steps_));
  if (windows_ < kFewest || !(products_(0, 0) > 0) || !(products_(1, 1) > 0)) return d;
  const Eigen::Matrix2d A = products_.topLeftCorner<2, 2>();
  const Eigen::Vector2d b = products_.topRightCorner<2, 1>();
  if (!(A.determinant() > 1e-9 * A(0, 0) * A(1, 1))) return d;
  const Eigen::Vector2d x = A.inverse() * b;  // lag/scale, 1/scale
  const double rest = std::max(0.0, products_(2, 2) - x.dot(b));
  const double without_lag = std::max(0.0, products_(2, 2) - b[1] * b[1] / A(1, 1));
  const Eigen::Matrix2d covariance = rest / static_cast<double>(windows_) * A.inverse();
  if (!(x[1] > 0)) return d;
  if (std::abs(1 / x[1] - 1) > kSameScale &&
      std::abs(x[1] - 1) > kSigmas * std::sqrt(covariance(1, 1)))
    d.scale = 1 / x[1];
  if (x[0] > kSigmas * std::sqrt(covariance(0, 0)) && without_lag - rest > kPlain * without_lag)
    d.lag_s = x[0] / x[1];
  return d;
}

}  // namespace twinrate

#include "identify/admittance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "model/matrix_exponential.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;
using Parameters = Eigen::Matrix<double, 5, 1>;  // ln L, ln R, c, k, d; standstill.hpp
constexpr int kMeasuredTicks = 6000;
constexpr double kSineSettle_s = 0.03, kSineVoltageUse = 0.9;

Complex admittance(const Parameters& p, double T_s, int period) {
  const double L = std::exp(p[0]), R = std::exp(p[1]);
  SmallMatrix A = SmallMatrix::Zero(4, 4);
  A.row(0) << -R / L, -1 / L, 0, 1 / L;
  A.row(1) << p[2], -p[4] * kTwoPi / (period * T_s), -p[3], 0;
  A(2, 1) = 1;
  const SmallMatrix step = matrix_exponential(A * T_s);
  const Complex z_inverse = std::polar(1.0, -kTwoPi / period);
  const Eigen::Matrix3cd M =
      Eigen::Matrix3cd::Identity() - z_inverse * step.topLeftCorner(3, 3).cast<Complex>();
  const Eigen::Vector3cd x =
      M.partialPivLu().solve(Eigen::Vector3cd(step.topRightCorner(3, 1).cast<Complex>()));
  return x[0];
}

// The last four rows keep R near that of direct current, and c, k and d near zero where the sines do
// not show them.
Eigen::VectorXd residual(const Parameters& p, const Parameters& scale, double R,
                         const std::vector<Sine>& sines, double T_s) {
  constexpr double kWeight = 1e-3, kWeightOfR = 0.2;
  Eigen::VectorXd r(2 * static_cast<Eigen::Index>(sines.size()) + 4);
  for (std::size_t s = 0; s < sines.size(); ++s) {
    const Complex ratio = std::log(sines[s].I_over_U / admittance(p, T_s, sines[s].period));
    r[2 * static_cast<Eigen::Index>(s)] = sines[s].weight * ratio.real();
    r[2 * static_cast<Eigen::Index>(s) + 1] = sines[s].weight * ratio.imag();
  }
  r[r.size() - 4] = kWeightOfR * (p[1] - std::log(R));
  r.tail(3) = kWeight * p.tail(3).cwiseQuotient(scale.tail(3));
  return r;
}

}  // namespace

std::vector<Sine> sweep(Experiment& e, const SweepPlan& plan, const std::vector<int>& periods) {
  std::vector<Sine> sines;
  const double most = kSineVoltageUse * e.u_max() - plan.u_hold.norm();
  for (const int period : periods) {
    const double omega = kTwoPi / (period * e.T_s());
    const double u = std::min(most, plan.i * std::hypot(plan.R, omega * plan.L));
    const auto angle = [&](int k) { return kTwoPi * (k % period) / period; };
    const auto one = [&](int k) -> const Row& {
      return e.apply(plan.u_hold + u * std::sin(angle(k)) * plan.axis);
    };
    const int settling = std::max(e.ticks(kSineSettle_s), 10 * period) / period * period;
    for (int k = 0; k < settling; ++k) one(k);
    Complex I, U;
    for (int k = 0; k < kMeasuredTicks / period * period; ++k) {
      const Row& row = one(k);
      I += row.i.dot(plan.axis) * std::polar(1.0, -angle(k));
      U += row.u.dot(plan.axis) * std::polar(1.0, -angle(k));
    }
    sines.push_back({period, I / U, 1});
  }
  return sines;
}

AxisFit fit_axis(std::vector<Sine> sines, double T_s, double R, bool gives_way) {
  if (gives_way)
    for (Sine& sine : sines) sine.weight = static_cast<double>(sines.front().period) / sine.period;
  const double omega = kTwoPi / (sines.front().period * T_s);
  const double L = std::max(std::imag(1.0 / sines.front().I_over_U) / omega, 1e-3 * R * T_s);
  const double omega_low = kTwoPi / (sines.back().period * T_s);
  Parameters p, scale;
  p << std::log(L), std::log(R), 0, 0, 0;
  scale << 1, 1, L * omega_low * omega_low, omega_low * omega_low, 1;
  if (gives_way) p[2] = 0.05 * scale[2];
  const Eigen::Index n = gives_way ? 5 : 2;
  Eigen::VectorXd r = residual(p, scale, R, sines, T_s);
  Eigen::MatrixXd jacobian(r.size(), n);
  double damping = 1e-3;
  for (int round = 0; round < 60; ++round) {
    for (Eigen::Index j = 0; j < n; ++j) {
      Parameters moved = p;
      moved[j] += 1e-5 * scale[j];
      jacobian.col(j) = (residual(moved, scale, R, sines, T_s) - r) / 1e-5;
    }
    Eigen::MatrixXd N = jacobian.transpose() * jacobian;
    N.diagonal().array() += damping * (1e-6 + N.diagonal().array());
    Parameters next = p;
    next.head(n) -= scale.head(n).cwiseProduct(N.ldlt().solve(jacobian.transpose() * r));
    const Eigen::VectorXd after = residual(next, scale, R, sines, T_s);
    if (!after.allFinite() || after.squaredNorm() >= r.squaredNorm()) {
      damping *= 10;
      if (damping > 1e6) break;
      continue;
    }
    p = next, r = after;
    damping = std::max(1e-9, 0.1 * damping);
  }
  Eigen::MatrixXd N = jacobian.transpose() * jacobian;
  // A mode that the sines do not show leaves its parameter free, not the inverse undefined.
  N.diagonal().array() += 1e-10 * N.diagonal().maxCoeff();
  const double variance = r.squaredNorm() / static_cast<double>(r.size() - n);
  const Eigen::MatrixXd covariance = variance * N.inverse();
  const auto found = [&](Eigen::Index j) {
    const double value = std::exp(p[j]);
    return Found{value, value * std::sqrt(covariance(j, j))};
  };
  return {found(0), found(1)};
}

}  // namespace twinrate

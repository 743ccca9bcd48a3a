#include "identify/admittance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "model/matrix_exponential.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;
using Parameters = Eigen::Matrix<double, 5, 1>;  // ln of L, R, c, k, d; standstill.hpp
constexpr int kMeasuredTicks = 6000;
constexpr double kSineSettle_s = 0.03, kSineVoltageUse = 0.9;

Complex admittance(const Parameters& p, double T_s, int period) {
  const double L = std::exp(p[0]), R = std::exp(p[1]);
  const double c = std::exp(p[2]), k = std::exp(p[3]), d = std::exp(p[4]);
  SmallMatrix A = SmallMatrix::Zero(4, 4);
  A.row(0) << -R / L, -1 / L, 0, 1 / L;
  A.row(1) << c, -d * kTwoPi / (period * T_s), -k, 0;
  A(2, 1) = 1;
  const SmallMatrix step = matrix_exponential(A * T_s);
  const Complex z_inverse = std::polar(1.0, -kTwoPi / period);
  const Eigen::Matrix3cd M =
      Eigen::Matrix3cd::Identity() - z_inverse * step.topLeftCorner(3, 3).cast<Complex>();
  const Eigen::Vector3cd x =
      M.partialPivLu().solve(Eigen::Vector3cd(step.topRightCorner(3, 1).cast<Complex>()));
  return x[0];
}

// The last row keeps R near that of direct current.
Eigen::VectorXd residual(const Parameters& p, double R, const std::vector<Sine>& sines,
                         double T_s) {
  constexpr double kWeightOfR = 0.2;
  Eigen::VectorXd r(2 * static_cast<Eigen::Index>(sines.size()) + 1);
  for (std::size_t s = 0; s < sines.size(); ++s) {
    const Complex ratio = std::log(sines[s].I_over_U / admittance(p, T_s, sines[s].period));
    r[2 * static_cast<Eigen::Index>(s)] = sines[s].weight * ratio.real();
    r[2 * static_cast<Eigen::Index>(s) + 1] = sines[s].weight * ratio.imag();
  }
  r[r.size() - 1] = kWeightOfR * (p[1] - std::log(R));
  return r;
}

struct Minimum {
  Parameters p;
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
};

// Levenberg-Marquardt in the first `n` parameters.
Minimum descend(Parameters p, Eigen::Index n, double R, const std::vector<Sine>& sines,
                double T_s) {
  constexpr double kStep = 1e-5, kLeastGain = 1e-9;
  constexpr double kMove = 2.3;  // a factor of ten: beyond it the derivatives say nothing
  Eigen::VectorXd r = residual(p, R, sines, T_s);
  Eigen::MatrixXd jacobian(r.size(), n);
  double damping = 1e-3;
  for (int round = 0; round < 60; ++round) {
    for (Eigen::Index j = 0; j < n; ++j) {
      Parameters moved = p;
      moved[j] += kStep;
      jacobian.col(j) = (residual(moved, R, sines, T_s) - r) / kStep;
    }
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    const double before = r.squaredNorm();
    for (; damping < 1e6; damping *= 10) {
      Eigen::MatrixXd N = normal;
      N.diagonal().array() += damping * (1e-6 + N.diagonal().array());
      const Eigen::VectorXd move = N.ldlt().solve(jacobian.transpose() * r);
      if (!(move.lpNorm<Eigen::Infinity>() < kMove)) continue;
      Parameters next = p;
      next.head(n) -= move;
      const Eigen::VectorXd after = residual(next, R, sines, T_s);
      if (!after.allFinite() || after.squaredNorm() >= before) continue;
      p = next, r = after;
      break;
    }
    if (r.squaredNorm() > (1 - kLeastGain) * before) break;
    damping = std::max(1e-9, 0.1 * damping);
  }
  return {p, r, jacobian};
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
    const int measured = kMeasuredTicks / period * period;
    sines.push_back({period, I / U, 1, 2 * std::abs(I) / measured});
  }
  return sines;
}

AxisFit fit_axis(std::vector<Sine> sines, double T_s, double R, bool gives_way) {
  if (gives_way)
    for (Sine& sine : sines) sine.weight = static_cast<double>(sines.front().period) / sine.period;
  const double omega = kTwoPi / (sines.front().period * T_s);
  const double L = std::max(std::imag(1.0 / sines.front().I_over_U) / omega, 1e-3 * R * T_s);
  const double omega_low = kTwoPi / (sines.back().period * T_s);
  const double stiff = omega_low * omega_low;
  Parameters start;
  start << std::log(L), std::log(R), -INFINITY, -INFINITY, -INFINITY;
  Minimum best;
  if (!gives_way) {
    best = descend(start, 2, R, sines, T_s);
  } else {
    // A heavy and a light rotor: from the wrong one the fit can end in another minimum.
    for (const double c : {1e-3, 0.03, 1.0, 30.0}) {
      start.tail(3) << std::log(c * L * stiff), std::log(0.03 * stiff), std::log(0.01);
      const Minimum found = descend(start, 5, R, sines, T_s);
      if (best.r.size() == 0 || found.r.squaredNorm() < best.r.squaredNorm()) best = found;
    }
  }
  Eigen::MatrixXd N = best.jacobian.transpose() * best.jacobian;
  // A mode that the sines do not show leaves its parameter free, not the inverse undefined.
  N.diagonal().array() += 1e-10 * N.diagonal().maxCoeff();
  const double variance =
      best.r.squaredNorm() / static_cast<double>(best.r.size() - best.jacobian.cols());
  const Eigen::MatrixXd covariance = variance * N.inverse();
  const auto found = [&](Eigen::Index j) {
    const double value = std::exp(best.p[j]);
    return Found{value, value * std::sqrt(covariance(j, j))};
  };
  double i = 0, weights = 0;
  for (const Sine& sine : sines) {
    i += sine.weight * sine.weight * sine.i;
    weights += sine.weight * sine.weight;
  }
  return {found(0), found(1), i / weights};
}

}  // namespace twinrate

#include "controller/riccati.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>

#include "model/matrix_exponential.hpp"

namespace twinrate {
namespace {

using Eigen::MatrixXd;

constexpr int kMostDoublings = 60;

MatrixXd riccati_residual(const DiscreteLqrProblem& p, const MatrixXd& X) {
  const MatrixXd S = p.A.transpose() * X * p.B + p.N;
  return p.A.transpose() * X * p.A - X -
         S * (p.R + p.B.transpose() * X * p.B).ldlt().solve(S.transpose()) + p.Q;
}

}  // namespace

DiscreteLqrProblem discretise_cost(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q,
                                   const MatrixXd& R, double T_s) {
  const Eigen::Index n = A.rows(), m = B.cols(), nm = n + m;
  MatrixXd F = MatrixXd::Zero(nm, nm), W = MatrixXd::Zero(nm, nm);  // of [x; u] and its cost
  F.topLeftCorner(n, n) = A;
  F.topRightCorner(n, m) = B;
  W.topLeftCorner(n, n) = Q;
  W.bottomRightCorner(m, m) = R;
  MatrixXd M = MatrixXd::Zero(2 * nm, 2 * nm);
  M << -F.transpose() * T_s, W * T_s, MatrixXd::Zero(nm, nm), F * T_s;
  const MatrixXd E = matrix_exponential(M);
  const MatrixXd Phi = E.bottomRightCorner(nm, nm);
  MatrixXd cost = Phi.transpose() * E.topRightCorner(nm, nm);
  cost = (0.5 * (cost + cost.transpose())).eval();
  return {Phi.topLeftCorner(n, n), Phi.topRightCorner(n, m), cost.topLeftCorner(n, n),
          cost.topRightCorner(n, m), cost.bottomRightCorner(m, m)};
}

RiccatiSolution solve_riccati(const DiscreteLqrProblem& p) {
  const Eigen::Index n = p.A.rows();
  const MatrixXd I = MatrixXd::Identity(n, n);
  const MatrixXd R_inv = p.R.inverse();
  MatrixXd A = p.A - p.B * R_inv * p.N.transpose();
  MatrixXd G = p.B * R_inv * p.B.transpose();
  MatrixXd H = p.Q - p.N * R_inv * p.N.transpose();
  RiccatiSolution s;
  for (s.iterations = 1; s.iterations <= kMostDoublings; ++s.iterations) {
    const MatrixXd W = (I + G * H).partialPivLu().solve(MatrixXd::Identity(n, n));
    const MatrixXd AW = A * W;
    const MatrixXd H_step = A.transpose() * H * W * A;
    G += AW * G * A.transpose();
    H += H_step;
    A = (AW * A).eval();
    if (!H.allFinite() || H_step.norm() <= 1e-15 * H.norm()) break;
  }
  s.X = 0.5 * (H + H.transpose());
  s.K = (p.R + p.B.transpose() * s.X * p.B)
            .ldlt()
            .solve(p.B.transpose() * s.X * p.A + p.N.transpose());
  s.residual =
      riccati_residual(p, s.X).norm() / std::max(s.X.norm(), std::numeric_limits<double>::min());
  bool stable = s.K.allFinite();
  if (stable)
    for (const auto& z : closed_loop_poles(p.A, p.B, s.K))
      stable = stable && std::abs(z) < 1 - 1e-12;
  s.converged = stable && s.residual < 1e-8;
  return s;
}

std::vector<std::complex<double>> closed_loop_poles(const MatrixXd& A, const MatrixXd& B,
                                                    const MatrixXd& K) {
  const Eigen::VectorXcd z = (A - B * K).eigenvalues();
  return {z.data(), z.data() + z.size()};
}

Margins margins(const MatrixXd& A_d, const MatrixXd& B_d, const MatrixXd& K, int delay,
                double T_s) {
  constexpr int kPoints = 20000;
  const Eigen::Index n = A_d.rows();
  const double w_hi = std::numbers::pi / T_s, w_lo = 1e-6 * w_hi;
  const auto loop = [&](double w) {
    const std::complex<double> z = std::polar(1.0, w * T_s);
    const Eigen::MatrixXcd zI_A =
        z * Eigen::MatrixXcd::Identity(n, n) - A_d.cast<std::complex<double>>();
    const Eigen::MatrixXcd x = zI_A.partialPivLu().solve(B_d.cast<std::complex<double>>());
    return (K.cast<std::complex<double>>() * x)(0, 0) * std::pow(z, -delay);
  };
  Margins found{.gain_up = std::numeric_limits<double>::infinity(),
                .gain_down = 0,
                .phase_rad = std::numeric_limits<double>::infinity()};
  std::complex<double> before = loop(w_lo);
  for (int i = 1; i <= kPoints; ++i) {
    const double w = w_lo * std::pow(w_hi / w_lo, static_cast<double>(i) / kPoints);
    const std::complex<double> L = loop(w);
    // Through the negative real axis.
    if (L.real() < 0 && before.real() < 0 && L.imag() * before.imag() <= 0) {
      const double share = before.imag() / (before.imag() - L.imag());
      const double at = -(before.real() + share * (L.real() - before.real()));
      if (at > 1) found.gain_down = std::max(found.gain_down, 1 / at);
      if (at > 0 && at <= 1) found.gain_up = std::min(found.gain_up, 1 / at);
    }
    // Through the unit circle.
    if ((std::abs(L) - 1) * (std::abs(before) - 1) <= 0) {
      const double phase = std::abs(std::arg(-L));
      if (phase < found.phase_rad) found.phase_rad = phase, found.crossover_rad_s = w;
    }
    before = L;
  }
  return found;
}

}  // namespace twinrate

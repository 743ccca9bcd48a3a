#include "controller/riccati.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "model/linear_algebra.hpp"
#include "model/math.hpp"
#include "model/matrix_exponential.hpp"

namespace twinrate {
namespace {

using Eigen::MatrixXd;

constexpr int kMostDoublings = 60;

// L' X R
MatrixXd between(const MatrixXd& L, const MatrixXd& X, const MatrixXd& R) {
  return L.transpose() * X * R;
}

MatrixXd riccati_residual(const DiscreteLqrProblem& p, const MatrixXd& X) {
  const MatrixXd S = between(p.A, X, p.B) + p.N;
  return between(p.A, X, p.A) - X -
         S * linear::solve_symmetric(p.R + between(p.B, X, p.B), S.transpose()) + p.Q;
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
  const MatrixXd R_inv = linear::inverse(p.R);
  const MatrixXd B_t = p.B.transpose(), N_t = p.N.transpose();
  MatrixXd A = p.A - between(B_t, R_inv, N_t);
  MatrixXd G = between(B_t, R_inv, B_t);
  MatrixXd H = p.Q - between(N_t, R_inv, N_t);
  RiccatiSolution s;
  for (s.iterations = 1; s.iterations <= kMostDoublings; ++s.iterations) {
    const MatrixXd W = linear::solve(I + G * H, I);
    const MatrixXd AW = A * W;
    const MatrixXd H_step = between(A, H, W) * A;
    G += between(AW.transpose(), G, A.transpose());
    H += H_step;
    A = (AW * A).eval();
    if (!H.allFinite() || H_step.norm() <= 1e-15 * H.norm()) break;
  }
  s.X = 0.5 * (H + H.transpose());
  s.K = linear::solve_symmetric(p.R + between(p.B, s.X, p.B), between(p.B, s.X, p.A) + N_t);
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
  const Eigen::VectorXcd z = linear::eigenvalues(A - B * K);
  return {z.data(), z.data() + z.size()};
}

// K (z I - A_d)^-1 B_d z^-delay at z = e^{jwT_s}; B_0 = [B_d; 0].
static std::complex<double> loop_gain(const MatrixXd& A_d, const MatrixXd& B_0, const MatrixXd& K,
                                      int delay, double w_T_s) {
  const Eigen::Index n = A_d.rows();
  const std::complex<double> z = math::polar(1.0, w_T_s);
  // In real numbers: [Re; Im].
  const MatrixXd im = z.imag() * MatrixXd::Identity(n, n),
                 re = z.real() * MatrixXd::Identity(n, n) - A_d;
  MatrixXd zI_A(2 * n, 2 * n);
  zI_A << re, -im, im, re;
  const MatrixXd x = linear::solve(zI_A, B_0);
  return std::complex(K.row(0).dot(x.col(0).head(n)), K.row(0).dot(x.col(0).tail(n))) *
         math::polar(1.0, -delay * w_T_s);
}

Margins margins(const MatrixXd& A_d, const MatrixXd& B_d, const MatrixXd& K, int delay,
                double T_s) {
  constexpr int kPoints = 20000;
  const Eigen::Index n = A_d.rows();
  const double w_hi = std::numbers::pi / T_s, w_lo = 1e-6 * w_hi;
  MatrixXd B_0 = MatrixXd::Zero(2 * n, 1);
  B_0.topRows(n) = B_d;
  Margins found{.gain_up = std::numeric_limits<double>::infinity(),
                .gain_down = 0,
                .phase_rad = std::numeric_limits<double>::infinity()};
  std::complex<double> before = loop_gain(A_d, B_0, K, delay, w_lo * T_s);
  for (int i = 1; i <= kPoints; ++i) {
    const double w = w_lo * math::pow(w_hi / w_lo, static_cast<double>(i) / kPoints);
    const std::complex<double> L = loop_gain(A_d, B_0, K, delay, w * T_s);
    // Through the negative real axis.
    if (L.real() < 0 && before.real() < 0 && L.imag() * before.imag() <= 0) {
      const double share = before.imag() / (before.imag() - L.imag());
      const double at = -(before.real() + share * (L.real() - before.real()));
      if (at > 1) found.gain_down = std::max(found.gain_down, 1 / at);
      if (at > 0 && at <= 1) found.gain_up = std::min(found.gain_up, 1 / at);
    }
    // Through the unit circle.
    if ((std::abs(L) - 1) * (std::abs(before) - 1) <= 0) {
      const double phase = std::abs(math::arg(-L));
      if (phase < found.phase_rad) found.phase_rad = phase, found.crossover_rad_s = w;
    }
    before = L;
  }
  return found;
}

}  // namespace twinrate

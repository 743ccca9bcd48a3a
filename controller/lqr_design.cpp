#include "controller/lqr_design.hpp"

#include <fmt/format.h>

#include "model/fields.hpp"
#include "model/frames.hpp"
#include "model/linear_algebra.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

AxisDesign d_axis(const MachineParameters& m, double K_pp) {
  AxisDesign axis;
  axis.states = {"i_d", "p_id"};
  axis.A = MatrixXd::Zero(2, 2);
  axis.A << -m.R_s / m.L_d, 0, 1, 0;
  axis.B = MatrixXd::Zero(2, 1);
  axis.B(0, 0) = K_pp / m.L_d;
  return axis;
}

AxisDesign q_axis(const MachineParameters& m, double K_pp) {
  AxisDesign axis;
  axis.states = {"i_q", "omega_m", "p_omega"};
  axis.A = MatrixXd::Zero(3, 3);
  axis.A << -m.R_s / m.L_q, 0, 0, m.torque_constant() / m.J, 0, 0, 0, 1, 0;
  axis.B = MatrixXd::Zero(3, 1);
  axis.B(0, 0) = K_pp / m.L_q;
  return axis;
}

VectorXd bryson(std::span<const double> deviation, double& R) {
  const auto n = static_cast<Eigen::Index>(deviation.size()) - 1;
  VectorXd Q(n);
  for (Eigen::Index i = 0; i < n; ++i) Q[i] = 1 / (deviation[i] * deviation[i]);
  R = 1 / (deviation[n] * deviation[n]);
  return Q;
}

RiccatiSolution solve(const AxisDesign& axis, const VectorXd& Q, double R, double T_s) {
  const MatrixXd R_matrix = MatrixXd::Constant(1, 1, R);
  return solve_riccati(discretise_cost(axis.A, axis.B, Q.asDiagonal(), R_matrix, T_s));
}

void complain_about_weights(AxisDesign& axis) {
  const Eigen::Index n = axis.Q.size();
  for (Eigen::Index i = 0; i < n; ++i)
    if (axis.Q[i] < 0)
      axis.complaints.push_back(
          fmt::format("weight of {} is negative ({:.3g}): the requested poles together are slower "
                      "than the open loop",
                      axis.states[static_cast<std::size_t>(i)], axis.Q[i]));
  if (!(axis.R > 0)) axis.complaints.push_back("the weight of the voltage must be positive");
  if (axis.Q[n - 1] == 0)
    axis.complaints.push_back(fmt::format(
        "weight of {} is zero: the cost does not contain the integral, so it gets no gain",
        axis.states.back()));
}

// From weights to gains.
void optimise(AxisDesign& axis, double T_s) {
  complain_about_weights(axis);
  axis.K = RowVectorXd::Zero(axis.A.rows());
  if (!axis.complaints.empty()) return;
  const MatrixXd R = MatrixXd::Constant(1, 1, axis.R);
  axis.problem = discretise_cost(axis.A, axis.B, axis.Q.asDiagonal(), R, T_s);
  const RiccatiSolution s = solve_riccati(axis.problem);
  axis.residual = s.residual;
  axis.iterations = s.iterations;
  if (s.converged)
    axis.K = s.K;
  else
    axis.complaints.push_back(fmt::format(
        "no stabilising solution found (Riccati residual {:.2g}): weights differ too much in size",
        s.residual));
}

void analyse(AxisDesign& axis, double T_s) {
  const MatrixXd none = MatrixXd::Zero(axis.A.rows(), axis.A.rows());
  if (axis.problem.A.size() == 0)
    axis.problem = discretise_cost(axis.A, axis.B, none, MatrixXd::Identity(1, 1), T_s);
  axis.poles = closed_loop_poles(axis.problem.A, axis.problem.B, axis.K);
  for (const auto& z : axis.poles)
    if (std::abs(z) >= 1) {
      axis.complaints.push_back("the gains do not stabilise this axis");
      break;
    }
}

// Element by element.
VectorXd exponentials(VectorXd x) {
  for (double& number : x) number = math::exp(number);
  return x;
}
VectorXd logarithms(VectorXd x) {
  for (double& number : x) number = math::log(number);
  return x;
}

// Relative error of each gain as a function of the logarithms of the weights.
VectorXd gain_error(const AxisDesign& axis, const VectorXd& log_Q, double T_s) {
  const RowVectorXd K = solve(axis, exponentials(log_Q), 1, T_s).K;
  return ((K.array() - axis.K.array()) / axis.K.array()).transpose();
}

MatrixXd gain_error_jacobian(const AxisDesign& axis, const VectorXd& log_Q, double T_s) {
  constexpr double kStep = 1e-5;
  MatrixXd J(log_Q.size(), log_Q.size());
  for (Eigen::Index i = 0; i < log_Q.size(); ++i) {
    VectorXd up = log_Q, down = log_Q;
    up[i] += kStep, down[i] -= kStep;
    J.col(i) = (gain_error(axis, up, T_s) - gain_error(axis, down, T_s)) / (2 * kStep);
  }
  return J;
}

}  // namespace

void LqrDesignParameters::fields(FieldVisitor& f) {
  f.choice("gains", gains, kGainSourceNames, "source of the gains");
  f.numbers("K_d", K_d, -1e6, 1e6, "given: gains on i_d (1/A), p_id (1/(A s)) (40)");
  f.numbers("K_q", K_q, -1e6, 1e6,
            "given: gains on i_q (1/A), omega_m (s/rad), p_omega (1/rad) (40)");
  f.numbers("Q_d", Q_d, 0, 1e12, "weights: of i_d^2, p_id^2");
  f.number("R_d", R_d, 1e-12, 1e12, "weights: of the normalised u_d^2");
  f.numbers("Q_q", Q_q, 0, 1e12, "weights: of i_q^2, omega_m^2, p_omega^2");
  f.number("R_q", R_q, 1e-12, 1e12, "weights: of the normalised u_q^2");
  f.numbers("deviation_d", deviation_d, 1e-9, 1e9,
            "deviations: largest i_d (A), p_id (A s), normalised u_d");
  f.numbers("deviation_q", deviation_q, 1e-9, 1e9,
            "deviations: largest i_q (A), omega_m (rad/s), p_omega (rad), normalised u_q");
  f.numbers("bandwidth_d_Hz", bandwidth_d_Hz, 1e-3, 1e5, "bandwidths: current, integral");
  f.numbers("bandwidth_q_Hz", bandwidth_q_Hz, 1e-3, 1e5, "bandwidths: current, speed, integral");
}

VectorXd weights_of_bandwidths(const AxisDesign& axis, const std::vector<double>& f_Hz) {
  // a(s) = s^(n-1) (s + a); the state below the j-th integration has b_j = g_1 .. g_j s^(n-j).
  const Eigen::Index n = axis.A.rows();
  const double a = -axis.A(0, 0);
  VectorXd e = VectorXd::Zero(n + 1);  // elementary symmetric polynomials of omega_i^2
  e[0] = 1;
  for (const double f : f_Hz) {
    const double omega2 = kTwoPi * kTwoPi * f * f;
    for (Eigen::Index k = n; k > 0; --k) e[k] += e[k - 1] * omega2;
  }
  VectorXd Q(n);
  double g = axis.B(0, 0);
  for (Eigen::Index j = 0; j < n; ++j) {
    if (j > 0) g *= axis.A(j, j - 1);
    Q[j] = (e[j + 1] - (j == 0 ? a * a : 0)) / (g * g);
  }
  return Q;
}

Margins margins_of(const AxisDesign& axis, int delay, double T_s) {
  return margins(axis.problem.A, axis.problem.B, axis.K, delay, T_s);
}

NearestWeights nearest_weights(const AxisDesign& axis, double T_s) {
  // Levenberg and Marquardt's damped normal equations.
  constexpr int kMostSteps = 200;
  constexpr double kLongest = 3, kNoNearer = 1e-8;  // a weight may be best at zero: far away
  NearestWeights nearest;
  VectorXd log_Q = logarithms(axis.K.array().square().matrix().transpose());
  VectorXd error = gain_error(axis, log_Q, T_s);
  double damping = 1e-3;
  for (int i = 0; i < kMostSteps && damping < 1e12; ++i) {
    const MatrixXd J = gain_error_jacobian(axis, log_Q, T_s);
    MatrixXd normal = J.transpose() * J;
    normal.diagonal() *= 1 + damping;
    const VectorXd step = linear::solve_symmetric(normal, J.transpose() * error);
    const VectorXd next = log_Q - step.cwiseMax(-kLongest).cwiseMin(kLongest);
    const VectorXd next_error = gain_error(axis, next, T_s);
    const double nearer = 1 - next_error.norm() / error.norm();
    damping *= nearer > 0 ? 0.1 : 10;
    if (nearer > 0) log_Q = next, error = next_error;
    if (nearer > 0 && nearer < kNoNearer) break;
  }
  nearest.Q = exponentials(log_Q);
  nearest.K = solve(axis, nearest.Q, 1, T_s).K;
  nearest.largest_error = ((nearest.K.array() - axis.K.array()) / axis.K.array()).abs().maxCoeff();
  return nearest;
}

LqrDesign design_lqr(const MachineParameters& machine, double v_dc, double T_s,
                     const LqrDesignParameters& p) {
  LqrDesign design;
  design.K_pp = v_dc / 2;
  design.d = d_axis(machine, design.K_pp);
  design.q = q_axis(machine, design.K_pp);
  switch (p.gains) {
    case GainSource::kGiven:
      design.d.K = Eigen::Map<const Eigen::RowVector2d>(p.K_d);
      design.q.K = Eigen::Map<const Eigen::RowVector3d>(p.K_q);
      break;
    case GainSource::kNumbers:
      design.d.Q = Eigen::Map<const Eigen::Vector2d>(p.Q_d);
      design.d.R = p.R_d;
      design.q.Q = Eigen::Map<const Eigen::Vector3d>(p.Q_q);
      design.q.R = p.R_q;
      break;
    case GainSource::kDeviations:
      design.d.Q = bryson(p.deviation_d, design.d.R);
      design.q.Q = bryson(p.deviation_q, design.q.R);
      break;
    case GainSource::kBandwidths:
      design.d.Q = weights_of_bandwidths(design.d, {p.bandwidth_d_Hz[0], p.bandwidth_d_Hz[1]});
      design.q.Q = weights_of_bandwidths(
          design.q, {p.bandwidth_q_Hz[0], p.bandwidth_q_Hz[1], p.bandwidth_q_Hz[2]});
      break;
  }
  for (AxisDesign* axis : {&design.d, &design.q}) {
    if (p.gains != GainSource::kGiven) optimise(*axis, T_s);
    analyse(*axis, T_s);
  }
  design.K_ff = -(machine.R_s / design.K_pp + design.q.K[0]) / machine.torque_constant();
  return design;
}

}  // namespace twinrate

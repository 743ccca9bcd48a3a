#include "trace/winding_voltage.hpp"

#include <algorithm>
#include <cmath>

#include "model/linear_algebra.hpp"

namespace twinrate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct LinearFit {
  VectorXd x, sigma, rest;
};

// Least squares; correlation between neighbouring rows widens the standard deviations.
LinearFit least_squares(const MatrixXd& A, const VectorXd& y) {
  LinearFit fit;
  fit.x = linear::least_squares(A, y);
  fit.rest = y - A * fit.x;
  const Index n = y.size();
  const double power = fit.rest.squaredNorm();
  const double r = std::clamp(fit.rest.head(n - 1).dot(fit.rest.tail(n - 1)) / power, 0.0, 0.98);
  const double variance =
      power / std::max<double>(1, static_cast<double>(n - A.cols())) * (1 + r) / (1 - r);
  fit.sigma =
      (variance * linear::pseudo_inverse(A.transpose() * A)).diagonal().cwiseMax(0).cwiseSqrt();
  return fit;
}

// Inverse-variance mean of R, and the residuals of all logs.
struct Sum {
  double weight = 0, R = 0, squares = 0, squares_declared = 0, rows = 0;
  void add(double R_log, double sigma, const VectorXd& rest, const VectorXd& declared) {
    const double w = 1 / std::max(sigma * sigma, 1e-18);
    weight += w;
    R += w * R_log;
    squares += rest.squaredNorm();
    squares_declared += (declared.array() - declared.mean()).matrix().squaredNorm();
    rows += static_cast<double>(rest.size());
  }
};

// Resistance at rest, and the orders of the ripple up to 8 n_p that exceed the others.
double fit_at_rest(const PositionLog& log, const MachineParameters& machine, WindingVoltage& found,
                   Sum& sum) {
  const Index n = static_cast<Index>(log.size());
  const VectorXd u = Eigen::Map<const VectorXd>(log.u_q.data(), n);
  const VectorXd i = Eigen::Map<const VectorXd>(log.i_q.data(), n);
  std::vector<int> orders;
  for (int N = 1; N <= 8 * machine.n_p; ++N) orders.push_back(N);
  LinearFit fit;
  for (int pass = 0; pass < 2; ++pass) {
    MatrixXd A(n, 2 + 2 * static_cast<Index>(orders.size()));
    A.col(0) = i;
    A.col(1).setOnes();
    for (std::size_t j = 0; j < orders.size(); ++j)
      for (Index k = 0; k < n; ++k) {
        const double angle = orders[j] * log.theta_m[static_cast<std::size_t>(k)];
        A(k, static_cast<Index>(2 + 2 * j)) = std::sin(angle);
        A(k, static_cast<Index>(3 + 2 * j)) = std::cos(angle);
      }
    // Normal equations: many rows, few well separated columns.
    if (pass == 0) {
      const VectorXd x = linear::solve_symmetric(A.transpose() * A, A.transpose() * u);
      std::vector<double> sizes;
      for (std::size_t j = 0; j < orders.size(); ++j)
        sizes.push_back(
            std::hypot(x[static_cast<Index>(2 + 2 * j)], x[static_cast<Index>(3 + 2 * j)]));
      std::vector<double> sorted(sizes);
      std::nth_element(sorted.begin(),
                       sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                       sorted.end());
      const double floor = sorted[sorted.size() / 2] / 1.177;
      const double most = *std::max_element(sizes.begin(), sizes.end());
      std::vector<int> kept;
      for (std::size_t j = 0; j < orders.size(); ++j)
        if (sizes[j] > 6 * floor && sizes[j] > 0.1 * most) kept.push_back(orders[j]);
      orders = std::move(kept);
    } else {
      fit = least_squares(A, u);
    }
  }
  for (std::size_t j = 0; j < orders.size(); ++j) {
    const double a = fit.x[static_cast<Index>(2 + 2 * j)], b = fit.x[static_cast<Index>(3 + 2 * j)];
    const double size = std::hypot(a, b), sigma = fit.sigma[static_cast<Index>(2 + 2 * j)];
    if (size > 5 * sigma)
      found.ripple.push_back({.order = orders[j],
                              .amplitude = size,
                              .phase = std::atan2(b, a),
                              .sigma_amplitude = sigma,
                              .sigma_phase = sigma / size});
  }
  sum.add(fit.x[0], fit.sigma[0], fit.rest, u - machine.R_s * i);
  return fit.x[0];
}

// Resistance in motion, from mean and change of every signal over windows of kLength rows.
double fit_in_motion(const PositionLog& log, const MachineParameters& machine,
                     WindingVoltage& found, Sum& sum) {
  constexpr std::size_t kLength = 20;
  const std::vector<double> u1 = running_integral(log.t, log.u_q);
  const std::vector<double> i1 = running_integral(log.t, log.i_q);
  const std::size_t count = (log.size() - 1) / kLength;
  const auto n = static_cast<Index>(count);
  MatrixXd A(n, 4);
  VectorXd u(n), i(n), omega_m(n);
  for (Index w = 0; w < n; ++w) {
    const std::size_t a = static_cast<std::size_t>(w) * kLength, b = a + kLength;
    const double time = log.t[b] - log.t[a];
    u[w] = (u1[b] - u1[a]) / time;
    i[w] = (i1[b] - i1[a]) / time;
    omega_m[w] = (log.theta_m[b] - log.theta_m[a]) / time;
    A.row(w) << i[w], omega_m[w], 1, (log.i_q[b] - log.i_q[a]) / time;
  }
  const LinearFit fit = least_squares(A, u);
  found.K_e = fit.x[1];
  sum.add(fit.x[0], fit.sigma[0], fit.rest,
          u - machine.R_s * i - machine.n_p * machine.psi_f * omega_m);
  if (!log.omega_m.empty()) {
    // The value from a fit row by row with the logged speed.
    const auto rows = static_cast<Index>(log.size());
    MatrixXd B(rows, 3);
    B << Eigen::Map<const VectorXd>(log.i_q.data(), rows),
        Eigen::Map<const VectorXd>(log.omega_m.data(), rows), VectorXd::Ones(rows);
    found.R_by_logged_speed = linear::solve_symmetric(
        B.transpose() * B, B.transpose() * Eigen::Map<const VectorXd>(log.u_q.data(), rows))(0);
  }
  return fit.x[0];
}

}  // namespace

WindingVoltage trace_winding_voltage(std::span<const PositionLog* const> at_rest,
                                     std::span<const PositionLog* const> in_motion,
                                     const MachineParameters& machine) {
  WindingVoltage found;
  Sum sum;
  for (const PositionLog* log : at_rest)
    if (log->has_time() && !log->u_q.empty())
      found.R_at_rest = fit_at_rest(*log, machine, found, sum);
  for (const PositionLog* log : in_motion)
    if (!log->u_q.empty()) found.R_in_motion = fit_in_motion(*log, machine, found, sum);
  if (sum.weight <= 0) return found;
  found.R = sum.R / sum.weight;
  found.sigma_R = 1 / std::sqrt(sum.weight);
  // Logs that disagree widen sigma to half their distance.
  if (found.R_at_rest > 0 && found.R_in_motion > 0)
    found.sigma_R = std::max(found.sigma_R, 0.5 * std::abs(found.R_at_rest - found.R_in_motion));
  found.rest = std::sqrt(sum.squares / sum.rows);
  found.rest_declared = std::sqrt(sum.squares_declared / sum.rows);
  found.rows = static_cast<std::size_t>(sum.rows);
  std::sort(found.ripple.begin(), found.ripple.end(),
            [](const Harmonic& a, const Harmonic& b) { return a.amplitude > b.amplitude; });
  return found;
}

}  // namespace twinrate

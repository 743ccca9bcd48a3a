#include "trace/loop_response.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "trace/parallel.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostRows = 20000, kFewestRows = 800;
constexpr double kUnstable = 30;   // limit of the loop's response, in multiples of the noise
constexpr double kForget_s = 0.2;  // of the motion: slower motion is the speed controller's
constexpr double kRidge = 1e-6;
constexpr double kRounding = 1e-9;  // V, A, rad: smaller changes count as none

// Usable rows whose last `before` rows are usable as well, spread over the record.
std::vector<std::size_t> usable_rows(const Record& record, int before) {
  std::vector<std::size_t> rows;
  int good = 0;
  for (std::size_t k = 0; k < record.size(); ++k) {
    good = record.electrical_ok[k] && record.motion_ok[k] ? good + 1 : 0;
    if (good > before) rows.push_back(k);
  }
  if (rows.size() <= kMostRows) return rows;
  std::vector<std::size_t> some;
  for (std::size_t j = 0; j < kMostRows; ++j) some.push_back(rows[j * rows.size() / kMostRows]);
  return some;
}

template <class T>
std::vector<T> second_differences(const std::vector<T>& x) {
  std::vector<T> out(x.size(), x[0] - x[0]);
  for (std::size_t k = 2; k < x.size(); ++k) out[k] = x[k] - 2 * x[k - 1] + x[k - 2];
  return out;
}

std::vector<Vec2> in_rotor_axes(const std::vector<Vec2>& alphabeta, const Record& record, int n_p) {
  std::vector<Vec2> dq(alphabeta.size());
  for (std::size_t k = 0; k < dq.size(); ++k) dq[k] = park(alphabeta[k], n_p * record.theta_m[k]);
  return dq;
}

}  // namespace

void SensorNoise::add(Record& record) const {
  for (std::size_t k = 0; k < record.i_alphabeta.size(); ++k)
    record.i_alphabeta[k] += i_alphabeta[k];
  for (std::size_t k = 0; k < record.theta_m.size(); ++k) record.theta_m[k] += theta_m[k];
}

LoopResponse::Inputs LoopResponse::inputs(std::size_t k, int axis, const std::vector<Vec2>& u,
                                          const std::vector<Vec2>& x,
                                          const std::vector<double>& y) {
  Inputs z;
  int n = 0;
  for (std::size_t j = 1; j <= kOrder; ++j) z[n++] = u[k - j][axis];
  for (std::size_t j = 0; j <= kOrder; ++j) {
    z[n++] = x[k - j][0];
    z[n++] = x[k - j][1];
    z[n++] = y[k - j];
  }
  return z;
}

LoopResponse::LoopResponse(const Record& record, const MachineParameters& machine)
    : machine_(machine) {
  if (!record.has_voltage_equation()) return;
  const std::vector<std::size_t> rows = usable_rows(record, kOrder + 2);
  if (rows.size() < kFewestRows) return;
  const auto u = second_differences(in_rotor_axes(record.u_alphabeta, record, machine.n_p));
  const auto x = second_differences(in_rotor_axes(record.i_alphabeta, record, machine.n_p));
  const auto y = second_differences(record.theta_m);
  for_each_index(2, [&](std::size_t n) {
    const int axis = static_cast<int>(n);
    Eigen::MatrixXd Z(static_cast<Eigen::Index>(rows.size()), kInputs);
    Eigen::VectorXd answer(Z.rows());
    for (Eigen::Index r = 0; r < Z.rows(); ++r) {
      const std::size_t k = rows[static_cast<std::size_t>(r)];
      Z.row(r) = inputs(k, axis, u, x, y).transpose();
      answer[r] = u[k][axis];
    }
    const double floor = kRounding * std::sqrt(static_cast<double>(Z.rows()));
    const Eigen::VectorXd size = Z.colwise().norm().cwiseMax(floor);
    Z *= size.cwiseInverse().asDiagonal();
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(kInputs, kInputs);
    A.selfadjointView<Eigen::Lower>().rankUpdate(Z.transpose());
    A.diagonal().array() += kRidge;
    const Inputs c = A.selfadjointView<Eigen::Lower>().ldlt().solve(Z.transpose() * answer);
    if (c.allFinite()) controller_[n] = c.cwiseQuotient(size);
  });
}

void LoopResponse::add(const SensorNoise& noise, Record& record) const {
  const std::size_t n = record.size();
  const double T_s = record.T_s, J = machine_.J > 0 ? machine_.J : 1e300;
  const double L_d = machine_.L_d, L_q = machine_.L_q;
  const double K_t = 1.5 * machine_.n_p * machine_.psi_f;
  std::vector<Vec2> x = noise.i_alphabeta, u(n, Vec2::Zero());
  std::vector<double> y = noise.theta_m;
  double sum = 0;
  for (const Vec2& v : x) sum += v.squaredNorm();
  const double limit = kUnstable * std::sqrt(sum / static_cast<double>(n));
  bool stable = record.has_voltage_equation();
  if (stable) x = in_rotor_axes(x, record, machine_.n_p);
  Vec2 i = Vec2::Zero();
  double omega_m = 0, theta_m = 0, omega_e = 0;
  for (std::size_t k = 0; stable && k < n; ++k) {
    x[k] += i;
    y[k] += theta_m;
    if (k >= kOrder)
      for (int axis = 0; axis < 2; ++axis)
        u[k][axis] = controller_[static_cast<std::size_t>(axis)].dot(inputs(k, axis, u, x, y));
    // The angle jumps across a seam, although the rotor does not.
    if (k + 1 < n && record.motion_ok[k] && record.motion_ok[k + 1])
      omega_e = machine_.n_p * (record.theta_m[k + 1] - record.theta_m[k]) / T_s;
    omega_m += T_s * (K_t / J * i[1] - omega_m / kForget_s);
    theta_m += T_s * (omega_m - theta_m / kForget_s);
    const Vec2 rate((u[k][0] - machine_.R_s * i[0] + omega_e * L_q * i[1]) / L_d,
                    (u[k][1] - machine_.R_s * i[1] - omega_e * L_d * i[0] -
                     machine_.n_p * machine_.psi_f * omega_m) /
                        L_q);
    i += T_s * rate;
    stable = i.norm() < limit;
  }
  if (!stable) return noise.add(record);
  for (std::size_t k = 0; k < n; ++k) {
    const double theta_e = machine_.n_p * record.theta_m[k];
    record.i_alphabeta[k] += inverse_park(x[k], theta_e);
    record.u_alphabeta[k] += inverse_park(u[k], theta_e);
    record.theta_m[k] += y[k];
  }
}

}  // namespace twinrate

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "identify/segmented_fit.hpp"
#include "identify/spin_fits.hpp"

namespace twinrate {
namespace {

// Columns: 1/J, B/J, T_C/J, T_0/J, a torque with the square of the speed, and a torque of one
// period a turn (sin, cos).
class MotionFit {
 public:
  MotionFit(const Experiment& e, const Identified& found) : fit_(7), found_(found), T_s_(e.T_s()) {}

  void add(const SpinRun& segment) {
    const Rows& rows = segment.rows;
    constexpr int kWindow = 8;
    const auto n = static_cast<int>(rows.size());
    if (n < 6 * kWindow) return;
    const int stride = std::max(1, n / 3000);
    const Eigen::Index m = (n - 1) / stride + 1;
    Eigen::MatrixXd local(m, 2), shared(m, 7);
    Eigen::VectorXd y(m);
    using Terms = Eigen::Matrix<double, 7, 1>;
    Terms once = Terms::Zero(), twice = Terms::Zero(), before = Terms::Zero();
    const auto theta = [&](int k) { return rows[static_cast<std::size_t>(k)].theta; };
    for (int k = 0; k < n; ++k) {
      const int a = std::max(0, k - kWindow), b = std::min(n - 1, k + kWindow);
      const double omega = (theta(b) - theta(a)) / ((b - a) * T_s_);
      const double sign = omega > 0 ? 1 : omega < 0 ? -1 : 0;
      Terms now;
      now << torque(rows[static_cast<std::size_t>(k)]), 0, -sign, -1, -omega * std::abs(omega),
          -std::sin(theta(k)), -std::cos(theta(k));
      if (k > 0) {
        Terms next = once + 0.5 * T_s_ * (before + now);
        next[0] += T_s_ * 1.5 * found_.n_p * found_.psi_f.value *
                   segment.ticks[static_cast<std::size_t>(k)].bow_q;
        twice += 0.5 * T_s_ * (once + next);
        once = next;
        twice[1] -= 0.5 * T_s_ * (theta(k) + theta(k - 1) - 2 * theta(0));
      }
      before = now;
      if (k % stride != 0) continue;
      const Eigen::Index r = k / stride;
      local.row(r) << 1, static_cast<double>(k) / n;
      shared.row(r) = twice.transpose();
      y[r] = theta(k);
    }
    fit_.add(local, shared, y);
  }
  SegmentedFit::Solution solve(const std::vector<Eigen::Index>& used) const {
    return fit_.solve(used);
  }

 private:
  double torque(const Row& row) const {
    const Vec2 i = park(row.i, found_.n_p * (row.theta - found_.theta_zero));
    const double psi_d = found_.psi_f.value + found_.L_d.value * i[0];
    return 1.5 * found_.n_p * (psi_d * i[1] - found_.L_q.value * i[1] * i[0]);
  }

  SegmentedFit fit_;
  const Identified& found_;
  double T_s_;
};

constexpr double kSigmasOfTerm = 4;  // of the jackknife

// Terms of the motion that are significant in the runs.
struct ShownTerms {
  SegmentedFit::Solution solution;
  double assisting = 0;  // Nm over J: a negative Coulomb torque, left out
};

// A torque with the square of the speed is tested first: without it the other terms fit a part of
// it.
bool has_fan(const SegmentedFit::Solution& fan, double omega) {
  constexpr double kFanShare = 0.2;
  const double square = fan.x[4] * omega * omega, other = fan.x[1] * omega + fan.x[2];
  return fan.x[4] > kSigmasOfTerm * fan.sigma[4] && square > kFanShare * (square + std::abs(other));
}

ShownTerms shown_terms(const MotionFit& motion, double omega) {
  constexpr double kShare = 0.02;
  std::vector<Eigen::Index> used = {0, 1, 2, 3};
  ShownTerms shown{.solution = motion.solve(used)};
  SegmentedFit::Solution& solution = shown.solution;
  const auto material = [&](Eigen::Index term) {
    const double size = std::abs(solution.x[term]) * (term == 1 ? omega : 1);
    const double all = std::abs(solution.x[1]) * omega + std::abs(solution.x[2]);
    return std::abs(solution.x[term]) > kSigmasOfTerm * solution.sigma[term] && size > kShare * all;
  };
  used.push_back(4);
  const auto fan = motion.solve(used);
  if (has_fan(fan, omega))
    solution = fan;
  else
    used.pop_back();
  for (const Eigen::Index term : {3, 2}) {
    const bool assists = term == 2 && solution.x[2] < 0;  // friction never drives
    if (material(term) && !assists) continue;
    if (assists && material(term)) shown.assisting = solution.x[2];
    std::erase(used, term);
    solution = motion.solve(used);
  }
  // A torque of one period a turn: unbalance, or an eccentric encoder.
  used.insert(used.end(), {5, 6});
  const auto once = motion.solve(used);
  const double swing = std::hypot(once.x[5], once.x[6]);
  // A small one is below its jackknife error, but still reduces the residual.
  constexpr double kFalls = 0.9;
  const bool is_seen = swing > kSigmasOfTerm * std::hypot(once.sigma[5], once.sigma[6]) ||
                       once.rms < kFalls * solution.rms;
  if (is_seen && swing > kShare * (std::abs(once.x[1]) * omega + std::abs(once.x[2])))
    solution = once;
  return shown;
}

}  // namespace

void find_motion(const Experiment& e, const std::vector<SpinRun>& segments, Identified& found) {
  // Relative errors of J and of the friction from quadrature and quantised angle, of the same
  // drives.
  constexpr double kErrorOfJ = 2e-4, kErrorOfFriction = 4e-3;
  // Relative to the test torque: currents within a tick that the loss of the inverter causes.
  constexpr double kErrorOfLoss = 5e-5;
  MotionFit motion(e, found);
  for (const SpinRun& s : segments) motion.add(s);
  const double omega = found.omega_m_max;
  const auto [solution, assisting] = shown_terms(motion, omega);
  const double J = 1 / solution.x[0];
  const double J_share = std::hypot(solution.sigma[0] / solution.x[0], kErrorOfJ);
  if (assisting < 0)
    found.notes.push_back(
        fmt::format("Coulomb friction: {:.2g} Nm fits best, a driving torque; it is left out, and "
                    "B_Nms is that of a fit without it",
                    assisting * J));
  const auto scaled = [&solution = solution, J, J_share](Eigen::Index term) {
    return Found{solution.x[term] * J,
                 std::hypot(solution.sigma[term] * J, solution.x[term] * J * J_share,
                            solution.x[term] * J * kErrorOfFriction)};
  };
  const double hidden = found.loss.V.value == 0
                            ? 0
                            : kErrorOfLoss * 1.5 * found.n_p * found.psi_f.value * found.i_max;
  found.J = {J, J * std::hypot(J_share, found.psi_f.sigma / found.psi_f.value)};
  found.B = scaled(1);
  found.B.sigma = std::hypot(found.B.sigma, hidden / omega);
  found.T_coulomb = scaled(2);
  found.T_constant = scaled(3);
  for (Found* friction : {&found.B, &found.T_coulomb})
    friction->sigma = std::hypot(friction->sigma, found.friction_share * friction->value);
  found.fan = scaled(4);
  found.T_sin = scaled(5), found.T_cos = scaled(6);
  if (found.B.value < kSigmasOfTerm * found.B.sigma) {
    found.notes.push_back(fmt::format("viscous friction: {:.2g} Nms is not above {:g} sigmas",
                                      found.B.value, kSigmasOfTerm));
    found.B.value = std::max(0.0, found.B.value);
  }
}

}  // namespace twinrate

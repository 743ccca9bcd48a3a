// Floquet multipliers of the closed loop: plant, computation delay, filter with its stale gain, and
// controller. The analysis of loop/stale_gain.hpp is that of the filter alone.
//
//   z        = [i_d, i_q, omega_m | u(k-1) .. u(k-delay) | x_hat
//               | angle and speed processing (active_flux, backemf_printed)
//               | integrators of the controller
//               | angle errors of the snapshots whose gains are in use and waiting]
//   z(k+1)   = f_k(z(k))            one tick, in the axes of the true rotor
//   Phi      = J_{n-1} .. J_1 J_0   J_k = df_k/dz along the periodic orbit, by central differences
//   rho      = largest |eigenvalue of Phi|, over one background period of n ticks
//
// One tick: controller on x_hat(k) and the currents of t_k -> voltage, which acts `delay_samples` later;
// the machine over T_s (Runge-Kutta); fast step of the filter with the gain of tick k+1. The gain is the
// periodic one of the policy in steady state (loop/stale_gain.hpp), turned by the angle error of its
// snapshot, because the background linearises at the estimate. The loop is the same at every rotor
// angle, so the angle of the rotor is no state. Noise, limits of voltage and current, effects and
// the start are left out.
//
// A loop that divides its ticks (speed_divider of `foc`, divider of active_flux) repeats after the
// least common multiple of n and the dividers; rho is nevertheless that of n ticks. Covered: every
// filter under `foc` and `lqr` with angle_source = "estimate", except active_flux with unequal
// noises of its alpha and beta states, and backemf_printed with these or on a salient machine:
// their loops depend on the angle.
// Operating point: the reference speed, constant load (the last of the profile), the periodic orbit of f
// with a gain every tick; the gain is that of the background at this point.
#pragma once
#include <optional>

#include "core/config.hpp"
#include "loop/stale_gain.hpp"

namespace twinrate {

// The control law while no limit is active.
struct ControlLaw;

class ClosedFloquet {
 public:
  // Empty if the drive is not covered, or no operating point is found.
  // `policy`: instead of that of the drive file.
  static std::optional<ClosedFloquet> of(Config& config, double omega_e,
                                         std::optional<GainPolicy> policy = {});
  // With the filter, the policy and the speed of `steady`, whose periodic gains it uses if there is
  // no load. `T_load`: instead of that of the drive file.
  static std::optional<ClosedFloquet> of(Config& config, const Steady& steady,
                                         std::optional<double> T_load = {});

  // rho over one background period.
  double spectral_radius(int n) const;
  // Frequency of the largest multiplier, Hz, folded into f_b/2: that of the growing oscillation.
  double frequency_Hz(int n) const;
  // Last n before the first with rho >= 1; at most `limit`. If the gain turns with the rotor or is
  // the same at every angle: `limit` if the loop is stable there, else by bisection.
  int n_max(int limit) const;
  // The limit of the filter alone, as loop/stale_gain.hpp.
  int n_max_of_filter(int limit) const { return n_max_by_floquet(steady_, limit); }
  // The operating point.
  const Steady& steady() const { return steady_; }

 private:
  ClosedFloquet() = default;
  Eigen::MatrixXd period(int n) const;
  int n_max_by_bisection(int limit) const;
  // One tick from t_k to t_{k+1}; `gain` in the axes of the rotor at t_k, of a period of n ticks.
  // `used`: working memory for the gain in use; it avoids a new Gain of 6 kB.
  Eigen::VectorXd tick(const Eigen::VectorXd& z, const Gain& gain, std::int64_t k, int n,
                       Gain& used) const;
  Eigen::MatrixXd derivative(const Eigen::VectorXd& z, const Gain& gain, std::int64_t k, int n,
                             Gain& used) const;
  double angle_error(const Eigen::VectorXd& z, double ticks_ahead) const;
  double gain_error(const Eigen::VectorXd& z) const;
  void take_snapshot(int i, int n, double turned, Eigen::VectorXd& z) const;
  bool settle();
  bool settle_under_load();
  // The filter's memory of a state at tick k, and back into `z`, seen from axes `turned` ahead.
  FastState memory_of(const Eigen::VectorXd& z, std::int64_t k) const;
  void remember(const FastState& state, double turned, Eigen::VectorXd& z) const;
  // Matrix of `ticks` ticks from `start`, which moves to their end.
  Eigen::MatrixXd transition(const std::vector<Gain>& gains, int ticks, Eigen::VectorXd& z) const;
  Eigen::Index x_at() const { return 3 + 2 * delay_; }
  Eigen::Index angle_at() const { return x_at() + n_x_; }
  Eigen::Index memory_at() const { return angle_at() + n_angle_; }
  Eigen::Index gain_at() const;
  int ticks_of_period(int n) const;

  Steady steady_;
  MachineParameters machine_;
  std::shared_ptr<const ControlLaw> law_;
  double T_load_ = 0;
  int delay_ = 1, n_x_ = 0;
  int n_angle_ = 0;     // states of the angle and speed processing
  int divider_ = 1;     // of the filter
  Eigen::VectorXd at_;  // the operating point
};

}  // namespace twinrate

// An experiment beyond the gain policies: one background run every n ticks that propagates the
// covariance through all n of them, and sends the gain for several speeds.
//
//   P(s)  = n Riccati steps in rotor axes from P(s - n), at the mean speed of the two snapshots
//   K_i   = the gain after n more steps from P(s) at the speeds
//           omega_i = omega_low + (abs(omega) + span - omega_low) (i/(N - 1))^2,  i = 0 .. N-1
//   K_use = T(theta) K(abs(omega_hat)) R(-theta), K linear between the K_i, odd elements with the
//           sign of omega_hat; theta and omega_hat of tick k-1
//
// used from s + n to s + 2n - 1 like policy `paper`; the first gain, computed from P_0 while the
// rotor still stands, from tick 1. Every gain comes from the covariance of the run.
#pragma once
#include <array>
#include <cmath>
#include <vector>

#include "core/rates.hpp"
#include "estimator/ekf_sensorless.hpp"
#include "estimator/gain_frame.hpp"

namespace twinrate::bench {

class PropagatedGain {
 public:
  static constexpr int kNodes = 6;
  static constexpr double kLow_rad_s = 10, kSpan_rad_s = 800;  // electrical

  PropagatedGain(std::shared_ptr<const EkfSensorless> filter, double T_s, int n_p, int n,
                 std::int64_t from)
      : filter_(std::move(filter)), T_s_(T_s), n_p_(n_p), rate_(n, from) {
    P_ = filter_->initial_gain();
  }

  // The gain of tick k; `last` is the estimate of tick k-1.
  Gain gain_for(std::int64_t k, const Estimate& last) const {
    std::int64_t snapshot = snapshot_for_tick(GainPolicy::kPaper, k, rate_);
    if (rate_.from == 0 && k < rate_.n) snapshot = 0;
    const Sent* best = nullptr;
    for (const Sent& sent : sent_)
      if (sent.k <= snapshot && (!best || sent.k > best->k)) best = &sent;
    if (!best) return filter_->initial_gain();
    Gain gain = interpolate(*best, last.x_hat[2]);
    GainFrame(1, last.theta_e).turn_gain(gain);
    return gain;
  }

  void take(const Estimate& e) {
    if (!is_snapshot(e.k, rate_)) return;
    const double omega_e = e.x_hat[2];
    const int n = rate_.n_at(e.k);
    const double mean = e.k == 0 || n == 1 ? omega_e : 0.5 * (omega_e + omega_before_);
    P_ = propagated(P_, mean, e.k == 0 ? 1 : n);
    omega_before_ = omega_e;
    Sent sent{.k = e.k};
    const Gain forward = omega_e < 0 ? mirrored(P_) : P_;
    for (int i = 0; i < kNodes; ++i) {
      const double share = static_cast<double>(i) / (kNodes - 1);
      sent.omega_e[i] = kLow_rad_s + (std::abs(omega_e) + kSpan_rad_s - kLow_rad_s) * share * share;
      sent.gain[i] = propagated(forward, sent.omega_e[i], n);
    }
    sent_[next_++ % sent_.size()] = sent;
  }

 private:
  struct Sent {
    std::int64_t k = -1'000'000;
    std::array<double, kNodes> omega_e{};
    std::array<Gain, kNodes> gain;
  };

  Gain propagated(Gain gain, double omega_e, int ticks) const {
    const Estimate at = *filter_->steady_state(omega_e / n_p_);
    const GainFrame back(1, -omega_e * T_s_);
    for (int i = 0; i < ticks; ++i) {
      back.turn_covariance(gain);
      gain = filter_->background_step(gain, at);
    }
    return gain;
  }
  // The same machine seen from behind: beta, speed and angle change sign.
  static Gain mirrored(Gain gain) {
    constexpr double sign[] = {1, -1, -1, -1};
    for (int row = 0; row < 4; ++row) {
      for (int col = 0; col < 2; ++col) gain.K(row, col) *= sign[row] * sign[col];
      for (int col = 0; col < 4; ++col) gain.P(row, col) *= sign[row] * sign[col];
    }
    return gain;
  }
  static Gain interpolate(const Sent& sent, double omega_e) {
    const double speed = std::abs(omega_e);
    std::size_t i = 0;
    while (i + 2 < kNodes && speed > sent.omega_e[i + 1]) ++i;
    const double low = sent.omega_e[i], high = sent.omega_e[i + 1];
    const double share = std::clamp((speed - low) / (high - low), 0.0, 1.0);
    Gain gain = sent.gain[i];
    gain.K += share * (sent.gain[i + 1].K - sent.gain[i].K);
    return omega_e < 0 ? mirrored(gain) : gain;
  }

  std::shared_ptr<const EkfSensorless> filter_;
  double T_s_;
  int n_p_;
  BackgroundRate rate_;
  Gain P_;
  double omega_before_ = 0;
  std::array<Sent, 4> sent_;
  std::size_t next_ = 0;
};

}  // namespace twinrate::bench

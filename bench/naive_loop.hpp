// The loop that an engineer writes first, as the opponent of loop/closed_loop.hpp on dilys2021:
// the machine by Runge-Kutta 4 in steps of 20 us, an extended Kalman filter in Eigen with fixed
// sizes, two PI current controllers and a PI speed controller. One gain every tick, one sample of
// delay, noise and ADC; no effects, no checks, no log.
#pragma once
#include <algorithm>
#include <random>

#include "bench/opponents.hpp"

namespace twinrate::bench {

class NaiveLoop {
 public:
  NaiveLoop() { ekf_.x[2] = 0; }
  void step() {
    const Vec2 i_alphabeta = measured(inverse_park(x_.head<2>(), 4 * x_[3]));
    ekf_.step({u_[0], u_[1], i_alphabeta[0], i_alphabeta[1]});
    const Vec2 u_next = controlled(i_alphabeta);
    for (int i = 0; i < 10; ++i) runge_kutta(kTs / 10);
    u_ = u_next;
  }
  double omega_e() const { return 4 * x_[2]; }

 private:
  Vec2 measured(const Vec2& i_alphabeta) {
    Vec3 i_abc = inverse_clarke(i_alphabeta);
    for (double& i : i_abc) i = std::round((i + 0.0245 * normal_(random_)) / 0.004) * 0.004;
    return clarke(i_abc);
  }
  Vec2 controlled(const Vec2& i_alphabeta) {
    const double omega_e = ekf_.x[2], theta_e = ekf_.x[3];
    const double k_T = 1.5 * m_.n_p * m_.psi_f, speed = kTwoPi * 8, current = kTwoPi * 200;
    omega_ref_ = std::min(400.0, omega_ref_ + 16000 * kTs);
    const double error = (omega_ref_ - omega_e) / m_.n_p;
    speed_integral_ += speed * speed / 4 * m_.J / k_T * error * kTs;
    const double i_q_ref = std::clamp(speed * m_.J / k_T * error + speed_integral_, -3.0, 3.0);
    const Vec2 i_dq = park(i_alphabeta, theta_e), e = Vec2(0, i_q_ref) - i_dq;
    current_integral_ += current * m_.R_s * e * kTs;
    const Vec2 emf = omega_e * Vec2(-m_.L_q * i_dq[1], m_.L_d * i_dq[0] + m_.psi_f);
    return inverse_park(current * m_.L_d * e + current_integral_ + emf,
                        theta_e + 1.5 * kTs * omega_e);
  }
  Eigen::Vector4d rate(const Eigen::Vector4d& x) const {
    const Vec2 u = park(u_, m_.n_p * x[3]);
    const double omega_e = m_.n_p * x[2];
    return {(u[0] - m_.R_s * x[0] + omega_e * m_.L_q * x[1]) / m_.L_d,
            (u[1] - m_.R_s * x[1] - omega_e * (m_.L_d * x[0] + m_.psi_f)) / m_.L_q,
            (m_.torque(x[0], x[1]) - m_.B * x[2]) / m_.J, x[2]};
  }
  void runge_kutta(double h) {
    const Eigen::Vector4d k1 = rate(x_), k2 = rate(x_ + 0.5 * h * k1), k3 = rate(x_ + 0.5 * h * k2),
                          k4 = rate(x_ + h * k3);
    x_ += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }

  const MachineParameters m_ = dilys();
  Eigen::Vector4d x_ = Eigen::Vector4d::Zero();
  Vec2 u_ = Vec2::Zero(), current_integral_ = Vec2::Zero();
  double speed_integral_ = 0, omega_ref_ = 0;
  EigenFilter<4, 2> ekf_;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
};

}  // namespace twinrate::bench

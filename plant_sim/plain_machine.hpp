// The plain machine over one Runge-Kutta step: the equations of plant_sim/drive_model.hpp without
// effects, every product of parameters formed once a step.
//
//   state   i_dq, the applied voltage in rotor axes, whose angle turns with the rotor, and omega_m,
//           theta_m:
//
//   u_d' =  n_p omega_m u_q
//   u_q' = -n_p omega_m u_d
//
// The rates are polynomials of this state: no sine. They are multiplied by the step h.
#pragma once
#include "model/four.hpp"
#include "model/pair.hpp"
#include "plant_sim/drive_model.hpp"

namespace twinrate {

struct PlainState {
  Four electrical;  // i_d, i_q, u_d, u_q
  Pair motion;      // omega_m, theta_m
};
[[gnu::always_inline]] inline PlainState operator+(const PlainState& a, const PlainState& b) {
  return {a.electrical + b.electrical, a.motion + b.motion};
}
[[gnu::always_inline]] inline PlainState operator-(const PlainState& a, const PlainState& b) {
  return {a.electrical - b.electrical, a.motion - b.motion};
}
[[gnu::always_inline]] inline PlainState operator*(double a, const PlainState& b) {
  return {a * b.electrical, a * b.motion};
}

class PlainMachine {
 public:
  // Over steps of length h.
  PlainMachine(const MachineParameters& m, double h)
      : h_(h),
        gain_{h / m.L_d, h / m.L_q},
        decay_(m.R_s * gain_),
        turn_{gain_[0] * m.n_p * m.L_q, -gain_[1] * m.n_p * m.L_d, h * m.n_p, -h * m.n_p},
        emf_{0, -gain_[1] * m.n_p * m.psi_f},
        torque_(h / m.J * m.torque_constant()),
        reluctance_(h / m.J * 1.5 * m.n_p * (m.L_d - m.L_q)),
        friction_(h / m.J * m.B),
        h_per_J_(h / m.J) {}

  double h() const { return h_; }
  // Change of omega_m over the step by a torque that is constant over it.
  double load(double T_load) const { return h_per_J_ * T_load; }
  [[gnu::always_inline]] PlainState rate(const PlainState& x, double load) const {
    const Four e = x.electrical;
    const Four across = __builtin_shufflevector(e, e, 1, 0, 3, 2);   // i_q, i_d, u_q, u_d
    const Four applied = __builtin_shufflevector(e, e, 2, 3, 2, 3);  // u_dq beside i_dq
    const double i_d = e[0], i_q = e[1], omega_m = x.motion[0];
    const double acceleration = (i_d * reluctance_ + torque_) * i_q - (omega_m * friction_ + load);
    return {applied * gain_ - e * decay_ + omega_m * (across * turn_ + emf_),
            Pair{acceleration, omega_m * h_}};
  }
  // The square of an error: of the currents and of their change by the error of u_dq in a step, A;
  // of the speed, rad/s; of the angle, rad times the weight.
  [[gnu::always_inline]] double size_squared(const PlainState& e, double weight_of_angle) const {
    const Four in_A = e.electrical * Four{1, 1, gain_[0], gain_[1]}, squared = in_A * in_A;
    const Pair motion = e.motion * Pair{1, weight_of_angle}, motion_squared = motion * motion;
    return (squared[0] + squared[2] + motion_squared[0]) +
           (squared[1] + squared[3] + motion_squared[1]);
  }

 private:
  double h_;
  Four gain_, decay_, turn_, emf_;  // of i_d, i_q, u_d, u_q
  double torque_, reluctance_, friction_, h_per_J_;
};

}  // namespace twinrate

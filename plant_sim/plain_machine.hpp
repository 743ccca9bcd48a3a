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
#include "model/pair.hpp"
#include "plant_sim/drive_model.hpp"

namespace twinrate {

struct PlainState {
  Pair i_dq, u_dq, motion;  // motion: omega_m, theta_m
};
inline PlainState operator+(const PlainState& a, const PlainState& b) {
  return {a.i_dq + b.i_dq, a.u_dq + b.u_dq, a.motion + b.motion};
}
inline PlainState operator-(const PlainState& a, const PlainState& b) {
  return {a.i_dq - b.i_dq, a.u_dq - b.u_dq, a.motion - b.motion};
}
inline PlainState operator*(double a, const PlainState& b) {
  return {a * b.i_dq, a * b.u_dq, a * b.motion};
}

class PlainMachine {
 public:
  // `T_load`: constant over the step of length h.
  PlainMachine(const MachineParameters& m, double T_load, double h)
      : h_(h),
        g_{h / m.L_d, h / m.L_q},
        a_(m.R_s * g_),
        cross_{g_[0] * m.n_p * m.L_q, -g_[1] * m.n_p * m.L_d},
        emf_{0, -g_[1] * m.n_p * m.psi_f},
        turn_{h * m.n_p, -h * m.n_p},
        torque_(h / m.J * m.torque_constant()),
        reluctance_(h / m.J * 1.5 * m.n_p * (m.L_d - m.L_q)),
        friction_(h / m.J * m.B),
        load_(h / m.J * T_load) {}

  PlainState operator()(double /*c*/, const PlainState& x) const {
    const double i_d = x.i_dq[0], i_q = x.i_dq[1], omega_m = x.motion[0];
    const double acceleration = (i_d * reluctance_ + torque_) * i_q - (omega_m * friction_ + load_);
    return {x.u_dq * g_ - x.i_dq * a_ + omega_m * (swapped(x.i_dq) * cross_ + emf_),
            omega_m * (swapped(x.u_dq) * turn_), Pair{acceleration, omega_m * h_}};
  }
  // The square of an error: A, what the error of u_dq makes of them in a step, rad/s, and rad with
  // a weight.
  double size_squared(const PlainState& e, double weight_of_angle) const {
    const Pair u = e.u_dq * g_, motion = e.motion * Pair{1, weight_of_angle};
    const Pair sum = e.i_dq * e.i_dq + u * u + motion * motion;
    return sum[0] + sum[1];
  }

 private:
  double h_;
  Pair g_, a_, cross_, emf_, turn_;
  double torque_, reluctance_, friction_, load_;
};

}  // namespace twinrate

// An operating point of the drive, and the contribution of an effect to the equations and readings
// there.
#pragma once
#include "model/frames.hpp"

namespace twinrate {

struct OperatingPoint {
  double t = 0;
  Vec2 i_dq = Vec2::Zero();
  Vec2 u_dq = Vec2::Zero();  // requested inverter voltage, limited
  double v_dc = 0;           // without the contributions of effects
  double omega_m = 0;
  double theta_m = 0;
  double theta_e = 0;  // n_p theta_m
  double T_load = 0;   // external load, if it is known
  // A, part of the terminal current that bypasses the winding that makes the flux (iron_loss).
  Vec2 i_around = Vec2::Zero();
  // A, change of the terminal current in stator axes over the interval that begins here. A drop that
  // bends with the current is then its mean over the interval. Zero: a moment.
  Vec2 i_moves = Vec2::Zero();
  // cos and sin of theta_e, if the caller has computed them; zero: they are computed on demand.
  Vec2 d_axis = Vec2::Zero();

  Vec2 rotor_axes(const Vec2& alphabeta) const {
    if (d_axis[0] == 0 && d_axis[1] == 0) return park(alphabeta, theta_e);
    return {d_axis[0] * alphabeta[0] + d_axis[1] * alphabeta[1],
            d_axis[0] * alphabeta[1] - d_axis[1] * alphabeta[0]};
  }
  Vec2 stator_axes(const Vec2& dq) const {
    if (d_axis[0] == 0 && d_axis[1] == 0) return inverse_park(dq, theta_e);
    return {d_axis[0] * dq[0] - d_axis[1] * dq[1], d_axis[1] * dq[0] + d_axis[0] * dq[1]};
  }
  // Three phase values as a vector in rotor axes.
  Vec2 phases_to_dq(const Vec3& x_abc) const { return rotor_axes(clarke(x_abc)); }
  // Current at the terminals, at which resistances, the inverter and the sensors are.
  Vec2 i_terminal() const { return i_dq + i_around; }
  // Its mean over the interval.
  Vec2 i_terminal_mean() const { return i_terminal() + 0.5 * rotor_axes(i_moves); }
  Vec3 i_abc() const { return inverse_clarke(stator_axes(i_terminal())); }
};

struct Contribution {
  double T_load = 0;              // Nm, adds to the load
  double J = 0;                   // kgm2, adds to the inertia (acts with the torque)
  Vec2 u_dq_drop = Vec2::Zero();  // V, subtracts from the applied voltage in rotor axes
  // Wb, adds to the flux linkages in rotor axes; the voltage of its change in stator axes, the
  // back-EMF and the torque 3/2 n_p (psi_d i_q - psi_q i_d) follow. A function of i_dq alone.
  Vec2 psi_dq = Vec2::Zero();
  double v_dc = 0;            // V, adds to the DC-bus voltage
  Vec3 i_abc = Vec3::Zero();  // A, adds to the reading of the current sensors
  double theta_m = 0;         // rad, adds to the reading of the position sensor
  double omega_m = 0;         // rad/s, adds to the reported speed, beyond what follows from the
                              // angle's reading

  Contribution& operator+=(const Contribution& other) {
    T_load += other.T_load;
    J += other.J;
    u_dq_drop += other.u_dq_drop;
    psi_dq += other.psi_dq;
    v_dc += other.v_dc;
    i_abc += other.i_abc;
    theta_m += other.theta_m;
    omega_m += other.omega_m;
    return *this;
  }
};

// Equations and readings that an effect enters: bits of acts_on().
enum Acts : int {
  kOnTorque = 1,    // T_load, J
  kOnVoltage = 2,   // u_dq_drop
  kOnBus = 4,       // v_dc
  kOnCurrents = 8,  // i_abc
  kOnAngle = 16,    // theta_m
  kOnFlux = 32,     // psi_dq
  kOnSpeed = 64,    // omega_m
};

}  // namespace twinrate

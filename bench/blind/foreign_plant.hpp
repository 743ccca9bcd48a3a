// A drive that shares no code with the project's plant (plant_sim/) and no function with its effects
// (model/effects/): fourth-order Runge-Kutta in rotor axes, and each effect as plain numbers.
#pragma once
#include <array>
#include <complex>

#include "model/machine.hpp"

namespace twinrate::blind {

// Zero: the effect is not there.
struct ForeignEffects {
  // Torques that oppose the motor, Nm; speeds in rad/s.
  double coulomb = 0, stribeck = 0, stribeck_speed = 1;
  bool sticks = false;  // dry friction holds a rotor at rest; false: it is smooth around zero speed
  double viscous = 0, fan = 0;  // Nm s, Nm s^2
  double constant = 0, step = 0, t_step = 0;
  double eccentric = 0, eccentric_phase = 0;
  double cogging = 0, cogging_order = 1, cogging_phase = 0;
  double ripple = 0, ripple_order = 1, ripple_phase = 0;  // of the friction
  double J_change = 0;                                    // kg m^2
  double J_load = 0, stiffness = 0, damping = 0, gap = 0;
  // Windings and magnets.
  double R_change = 0, R_tau = 0, R_a = 0, L_d_change = 0, L_q_change = 0, psi_change = 0;
  double saturation_A = 0;                                      // psi_q = L_q i_q/(1 + |i_q|/I)
  double harmonic = 0, harmonic_order = 6, harmonic_phase = 0;  // Wb; order a turn
  double R_iron = 0;
  // Inverter.
  double drop_V = 0, drop_Ohm = 0, drop_zone_A = 1, gain = 0, offset_a_V = 0, offset_b_V = 0;
  double bus_V = 0, bus_Hz = 0, bus_phase = 0;
  double late_voltage_s = 0;  // less than a tick
};

class ForeignPlant {
 public:
  using Vector = std::complex<double>;  // in stator axes

  ForeignPlant(const MachineParameters& machine, double v_dc, const ForeignEffects& effects)
      : m_(machine), v_dc_(v_dc), x_(effects) {}

  void place(double theta, double omega);
  // From t to t + T_s under the voltage `u`, asked for at t; `u_before`: that of the tick before.
  void advance(double t, double T_s, Vector u, Vector u_before, double T_load);

  Vector current() const { return terminal_current(state_); }  // at the terminals
  double bus_voltage(double t) const;
  double theta() const { return state_[kTheta]; }
  double omega() const { return state_[kOmega]; }

 private:
  enum { kCurrentD, kCurrentQ, kOmega, kTheta, kOmegaLoad, kThetaLoad, kStates };
  using State = std::array<double, kStates>;

  Vector terminal_current(const State& s) const;
  Vector winding_voltage(const State& s, Vector u) const;
  State rate(const State& s, double t, Vector u, double T_load, double step) const;
  double speed_rate(const State& s, double torque, double J, double step) const;
  double load_torque(const State& s) const;
  double shaft_torque(const State& s) const;

  MachineParameters m_;
  double v_dc_;
  ForeignEffects x_;
  State state_{};
};

}  // namespace twinrate::blind

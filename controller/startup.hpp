// Start from an unknown angle (start = "align_if"): alignment, then an I/f ramp, then the hand-over
// to the estimate.
//
//   align   A constant voltage R_s i_start, first at 90 deg, then at 0 deg electrical. The rotor
//           turns onto it, damped by the currents that its own EMF drives through R_s. With two
//           steps no initial angle has zero torque.
//   I/f     A current vector i_start turns with a rising frequency; the rotor follows it.
//   check   From omega_handover on, the estimate must turn with the vector for t_agree_s: speed
//           within 30 %, angle within 75 deg. Then the controller takes over the estimated angle.
//           Without agreement within t_give_up_s: safe mode.
#pragma once
#include "controller/controller.hpp"
#include "controller/pi.hpp"

namespace twinrate {

struct StartupParameters {
  double i_start = 0;
  double t_align = 0.3, omega_e_handover = 150, acceleration = 1000;
  double t_agree = 0.02, t_give_up = 1.0;
  double t_fade = 0.05;
  void fields(FieldVisitor& f) {
    f.number("i_start_A", i_start, 0, 1e4, "current of alignment and I/f ramp; 0: i_max_A");
    f.number("t_align_s", t_align, 0.01, 10, "duration of each of the two alignment steps");
    f.number("acceleration_rad_s2", acceleration, 1, 1e6,
             "acceleration of the I/f ramp, electrical");
    f.number("omega_e_handover_rad_s", omega_e_handover, 1, 1e5,
             "electrical speed of the hand-over");
    f.number("t_agree_s", t_agree, 1e-3, 10,
             "time for which the estimate must agree before the hand-over");
    f.number("t_give_up_s", t_give_up, 0.01, 100,
             "time after the ramp at which a missing agreement leads to safe mode");
    f.number("t_fade_s", t_fade, 1e-3, 10,
             "time in which the d current of the ramp fades after the hand-over");
  }
};

class Startup {
 public:
  // Inactive (Mode::kRun from the first tick) unless `active`.
  Startup(const StartupParameters& p, bool active, double T_s);

  struct Drive {
    Mode mode = Mode::kRun;
    double theta_e = 0, omega_e = 0;  // of the forced vector
    bool handed_over = false;         // this tick is the first on the estimate
  };
  Drive step(const Estimate& e, double omega_e_hat, double direction);
  Mode mode() const { return mode_; }

 private:
  StartupParameters p_;
  double T_s_;
  Mode mode_;
  double t_in_mode_ = 0, t_agreed_ = 0, t_at_speed_ = 0;
  double theta_e_ = 0, omega_e_ = 0;
};

// The event of a change to this mode.
ControllerEvent mode_change(Mode mode);

// The current of alignment and I/f ramp, for a controller without a current loop of its own.
//
//   align   u = [R_s i_start; 0]
//   I/f     PI with pole cancellation on [i_start; 0] in the forced axes, |u| <= u_max
class ForcedCurrent {
 public:
  ForcedCurrent(const MachineParameters& machine, double i_start, double bandwidth_Hz, double T_s);
  Vec2 step(Mode mode, const Vec2& i_dq, double omega_e, double u_max);
  Vec2 i_dq_ref() const { return {i_start_, 0}; }

 private:
  MachineParameters machine_;
  double i_start_, T_s_;
  Pi d_, q_;
};

}  // namespace twinrate

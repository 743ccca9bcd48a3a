// Field-oriented control on the estimates: speed PI -> current PI with decoupling -> voltage.
//
//   I_s      = PI(omega_m_ref - omega_m)               every speed_divider ticks, |I_s| <= i_max
//   i_dq_ref = [i_d_ref; I_s]                          current_angle = "reference"
//   i_dq_ref = MTPA point of I_s + [i_d_ref; 0]        current_angle = "mtpa"
//   u_d      = PI(i_d_ref - i_d) - omega_e L_q i_q
//   u_q      = PI(i_q_ref - i_q) + omega_e (L_d i_d + psi_f)
//   |u_dq|  <= v_dc/sqrt3                              on the circle, the direction is kept
//
// Field weakening and current limit: controller/current_reference.hpp. compensate_effects adds the
// torque of the model's effects, over K_t, to I_s, and their voltage loss to u_dq. compensation =
// "load" adds instead the current of the estimated load, which holds the torque of known effects:
//
//   T_ff     = T_load + tau dT_load/dt,  tau = 1/(2 pi current_bandwidth) + (delay_samples + 1/2) T_s
//
// A change of the compensation while running does not make I_s jump: the integral of the speed loop
// takes over the difference. The voltage is
// turned to the stationary frame with the angle that the rotor has when the voltage acts.
// The currents are the measured ones, turned with the estimated angle. start = "align_if":
// controller/startup.hpp. Lost synchronism: controller/watched.hpp.
// A tick with a measurement or an estimate that is not finite repeats the last command and changes
// no state.
#pragma once
#include "controller/controller.hpp"
#include "controller/current_reference.hpp"
#include "controller/mechanical_angle.hpp"
#include "controller/pi.hpp"
#include "controller/startup.hpp"
#include "controller/synchronism.hpp"

namespace twinrate {

struct FocParameters {
  double current_bandwidth = 200, speed_bandwidth = 8;
  double i_max = 0;
  int speed_divider = 1;
  CurrentAngle current_angle = CurrentAngle::kReference;
  FieldWeakeningParameters field_weakening;
  bool decoupling = true;
  bool compensate_effects = false;
  StartupParameters startup;
  SynchronismParameters synchronism;
  void fields(FieldVisitor& f) {
    f.number("current_bandwidth_Hz", current_bandwidth, 1, 5000, "bandwidth of the current loop");
    f.number("speed_bandwidth_Hz", speed_bandwidth, 0.01, 1000, "bandwidth of the speed loop");
    f.integer("speed_divider", speed_divider, 1, 1000,
              "control ticks of one step of the speed loop");
    f.choice("current_angle", current_angle, kCurrentAngleNames,
             "i_d = reference.i_d_A, or maximum torque per ampere (plus reference.i_d_A)");
    f.number("i_max_A", i_max, 1e-3, 1e4, "largest current amplitude",
             i_max > 0 ? Presence::kOptional : Presence::kRequired);
    field_weakening.fields(f);
    f.boolean("decoupling", decoupling, "feed back-EMF and cross coupling forward");
    f.boolean("compensate_effects", compensate_effects,
              "feed forward torque and voltage loss of the effects in the model (used_in)");
    f.table("startup", [&](FieldVisitor& sub) { startup.fields(sub); });
    f.table("synchronism", [&](FieldVisitor& sub) { synchronism.fields(sub); });
  }
};

class Foc final : public Controller {
 public:
  Foc(const DriveConfig& config, const FocParameters& parameters);
  std::string_view kind() const override { return "foc"; }
  Command step(const ControllerInput& in) override;
  ControllerEvent take_event() override;
  void know(const Effects& model_effects) override;
  void follow_compensation(const Profile& compensation) override {
    choice_.compensation = compensation;
  }

 private:
  struct Frame {
    double theta_e, omega_m, theta_m = 0;
  };
  bool finite(const ControllerInput& in, const Frame& frame) const;
  Frame rotor_frame(const ControllerInput& in) const;  // without theta_m
  // The mode of this tick; `frame` becomes the forced one during alignment and I/f ramp.
  Mode advance_mode(const ControllerInput& in, Frame& frame);
  // Voltage of mode c.mode in the frame of c; fills in c.i_dq_ref.
  Vec2 voltage(const ControllerInput& in, const Frame& frame, Command& c);
  void hand_over(const ControllerInput& in, const Frame& frame, double theta_e_forced);
  Vec2 predicted_voltage_loss(const ControllerInput& in, const Frame& frame,
                              const Vec2& u_dq) const;
  Vec2 closed_loop_reference(const ControllerInput& in, const Frame& frame);
  // Current of the feed-forward of the speed loop; takes over a change of the compensation.
  double load_current(const ControllerInput& in, const Frame& frame);
  double predicted_load(const ControllerInput& in, const Frame& frame) const;
  Vec2 feed_forward(const Vec2& i_dq, double omega_e) const;
  Vec2 current_loop(const Vec2& i_dq_ref, const Vec2& i_dq, double omega_e, double v_dc);

  const MachineParameters machine_;
  const FocParameters p_;
  Effects effects_, on_voltage_;
  const AngleSource angle_source_;
  ControllerChoice choice_;
  const double T_s_, advance_s_, slew_rate_, lead_s_;
  MechanicalAngle mechanical_angle_;
  Compensation compensation_;
  Pi speed_, current_d_, current_q_;
  FieldWeakening field_weakening_;
  Startup startup_;
  double omega_m_ref_ = 0;
  int speed_ticks_ = 0;              // since the speed loop's last step
  Vec2 i_dq_wanted_ = Vec2::Zero();  // of the speed loop, before field weakening
  ControllerEvent event_;
  Command command_;           // the last one: repeated for an input that is not finite
  Vec2 u_dq_ = Vec2::Zero();  // of the last step, in the frame of that step
  double i_d_handover_ = 0;   // d current taken over from the I/f ramp, faded out
};

}  // namespace twinrate

// State feedback with feed-forward of the estimated load.
//
//   inputs   i_d, i_q, omega_m, theta_e of the filter; T_o, dT_o/dt of the estimate
//   output   u = [u_d, u_q], normalised by K_pp = v_dc/2                                       (32)
//
// Integrals, every T_s:
//
//   p_id    += T_s (i_d - i_d_ref - k_awu u_d_awu)                                       (35), (39)
//   p_omega += T_s (omega_m - omega_m_ref - k_awu u_q_awu)                               (36), (39)
//
// Control law:
//
//   u_d = -K_d [i_d; p_id] + (K_id + R_s/K_pp) i_d_ref                                        (38)*
//         - n_p omega_m L_q i_q/K_pp                                                           (33)
//   u_q = -K_q [i_q; omega_m; p_omega]                                                         (38)
//         + n_p omega_m (L_d i_d + psi_f)/K_pp                                                 (34)
//         - K_ff (T_o + tau dT_o/dt)                   compensation = "load", "paper"    (38), (41)
//         + u_ff(theta_m)                              compensation = "angle_domain"
//   u   = u + known voltage loss/K_pp                  effects with used_in = "model" or "both"
//   tau = L_q/(R_s + K_pp K_iq) + T_d,  T_d = (delay_samples + 1/2) T_s
//
// tau is the lag of the current loop. The filter of the paper publishes no rate: dT_o/dt = 0. The
// known voltage loss holds the EMF of known flux; T_o holds the torque of known flux.
//
// * The term of i_d_ref is not in the paper, whose reference is 0: without it i_d follows at the
//   speed of its integral.
//
// The reference of i_d:
//
//   i_d_ref = reference.i_d_A + i_d_fw                     current_angle = "reference"
//   i_d_ref = MTPA i_d of LP(i_q) + the same               current_angle = "mtpa"
//
// i_d_fw: field weakening (controller/current_reference.hpp). LP is a low-pass five times slower than
// the current loop: to the q axis i_d is a parameter. On a salient rotor K_t depends on it:
//
//   K_t(i_d) = 3/2 n_p [psi_f + (L_d - L_q) i_d]
//
// and K_q is that of the optimum at K_t(i_d_ref), linear between kOperatingPoints designs from
// -i_max to 0. A change of K_q does not move u_q: p_omega takes over the difference. Given gains are
// not scheduled.
//
// start = "align_if" (controller/startup.hpp): at the hand-over p_id and p_omega take the values with
// which the law asks for the voltage of the ramp, in the axes of the estimate; the i_d of the ramp
// fades within t_fade_s. start = "flying": the same at the first tick, with the voltage that holds
// the present currents at the present speed,
//
//   u_d = [R_s i_d - n_p omega_m L_q i_q]/K_pp
//   u_q = [R_s i_q + n_p omega_m (L_d i_d + psi_f)]/K_pp
//
// Current limit (MPAC), with i_d, i_q at the instant at which the voltage of this tick begins to
// act, predicted through the voltages that are still on their way:
//
//   u_q(i)  = [(i - i_q) L_q/T_s + R_s i_q + n_p omega_m (L_d i_d + psi_f)]/K_pp
//   u_q     within [u_q(-i_q_max), u_q(i_q_max)],  i_q_max = sqrt(i_max^2 - i_d^2), at least 0.1 i_max
//
// The last lets |i| reach 1.005 i_max. Without it an i_d of i_max, as an I/f ramp ends with, would take
// the least i_q to zero within one tick.
//
// Voltage limit, and the anti-windup of the integrals:
//
//   |u_d| <= min(1, u_c),  |u_q| <= min(1, sqrt(u_c^2 - u_d^2)),  u_c = v_dc/(sqrt3 K_pp)
//   u_awu  = u limited - u requested
//
// A change of the compensation while running does not make u_q jump: p_omega takes over the
// difference of the feed-forward. A tick with an input that is not finite repeats the last command
// and changes no state.
// Source: Niewiara 2020, section 6, corrected (docs/theory/state-feedback.md, "Errata of the
// paper").
#pragma once
#include <array>

#include "controller/angle_domain.hpp"
#include "controller/current_reference.hpp"
#include "controller/lqr_design.hpp"
#include "controller/mechanical_angle.hpp"
#include "controller/startup.hpp"
#include "controller/synchronism.hpp"

namespace twinrate {

struct LqrParameters {
  LqrDesignParameters design;
  double i_max = 0, k_awu = 5;
  CurrentAngle current_angle = CurrentAngle::kReference;
  FieldWeakeningParameters field_weakening;
  StartupParameters startup;
  SynchronismParameters synchronism;
  AngleDomainParameters angle_domain;
  void fields(FieldVisitor& f) {
    design.fields(f);
    f.number("i_max_A", i_max, 1e-3, 1e4, "largest current amplitude (MPAC)",
             i_max > 0 ? Presence::kOptional : Presence::kRequired);
    f.number("k_awu_rad_s", k_awu, 0, 1e6,
             "anti-windup gain of (39), per unit of normalised voltage");
    f.choice("current_angle", current_angle, kCurrentAngleNames,
             "i_d = reference.i_d_A, or maximum torque per ampere (plus reference.i_d_A)");
    field_weakening.fields(f);
    f.table("startup", [&](FieldVisitor& sub) { startup.fields(sub); });
    f.table("synchronism", [&](FieldVisitor& sub) { synchronism.fields(sub); });
    f.table("angle_domain", [&](FieldVisitor& sub) { angle_domain.fields(sub); });
  }
};

class Lqr final : public Controller {
 public:
  Lqr(const DriveConfig& config, const LqrParameters& parameters, const LqrDesign& design);
  std::string_view kind() const override { return "lqr"; }
  Command step(const ControllerInput& in) override;
  void know(const Effects& model_effects) override;
  void follow_compensation(const Profile& compensation) override {
    compensation_choice_.compensation = compensation;
  }
  ControllerEvent take_event() override;
  std::string learnt() const override;

 private:
  struct State {
    double theta_e, theta_m, omega_m;
    Vec2 i_dq;
  };
  State state_of(const ControllerInput& in);
  // The mode of this tick; hands over, or gives `u` in the forced axes of `theta_e`.
  Mode advance_mode(const ControllerInput& in, const State& x, double T_o);
  // p_id and p_omega with which the law asks for `u` (normalised) now; the i_d of now fades.
  void take_over(const ControllerInput& in, const State& x, const Vec2& u, double T_o);
  Vec2 holding_voltage(const State& x) const;
  // The voltage of the ramp, or none in safe mode.
  Command forced(const ControllerInput& in, Mode mode);
  Command run(const ControllerInput& in, const State& x, double T_o);
  void schedule_gains(const State& x);
  double i_d_wanted(const ControllerInput& in) const;
  // u_d and u_q of the law without K_d [0; p_id] and K_q [0; 0; p_omega].
  Vec2 law_without_integrals(const State& x, double T_o) const;
  void keep(const Command& c);
  void switch_compensation(double t, double T_o);
  Vec2 control_law(const State& x, double T_o);
  Vec2 limit(const State& x, const Vec2& u, double v_dc) const;
  Vec2 with_known_voltage_loss(const Vec2& u, const State& x, const Measurement& m) const;
  Vec2 currents_when_it_acts(const State& x) const;

  const MachineParameters machine_;
  const LqrParameters p_;
  const Vec2 K_d_;
  Vec3 K_q_;
  static constexpr int kOperatingPoints = 9;
  std::vector<Vec3> K_q_of_i_d_;  // from i_d = -i_max to 0; empty: not scheduled
  const double K_pp_, R_s_K_pp_;
  double K_ff_;
  const double lead_s_;
  ControllerChoice compensation_choice_;
  const AngleSource angle_source_;
  const double T_s_, advance_s_, slew_rate_;
  const int delay_;
  AngleDomain angle_domain_;
  MechanicalAngle mechanical_angle_;
  FieldWeakening field_weakening_;
  Startup startup_;
  ForcedCurrent forced_;
  Startup::Drive drive_;  // of this tick
  Vec2 u_forced_ = Vec2::Zero();
  double i_q_slow_ = 0, share_;  // LP(i_q), and the share of a new sample
  double i_d_handover_ = 0;      // taken over from the ramp, faded out
  bool flying_;                  // until the first tick
  Effects known_flux_, known_voltage_;
  Compensation compensation_;
  double p_id_ = 0, p_omega_ = 0, omega_m_ref_ = 0, i_d_ref_ = 0;
  Vec2 u_awu_ = Vec2::Zero();
  std::array<Vec2, 4> pending_{};  // volts in stationary axes, on their way; newest at [0]
  Command command_;
  ControllerEvent event_;
};

}  // namespace twinrate

// State feedback with feed-forward of the estimated load (Niewiara 2020, section 6, corrected).
//
//   p_id += T_s (i_d - i_d_ref - k_awu u_d_awu),  p_omega += T_s (omega_m - omega_m_ref - k_awu
//   u_q_awu)
//                                                                          (35), (36), (39)
//   u_d = -K_d [i_d, p_id]           - n_p omega_m L_q i_q/K_pp            (38), (33)
//   u_q = -K_q [i_q, omega_m, p_omega] + n_p omega_m (L_d i_d + psi_f)/K_pp (38), (34)
//         - K_ff (T_o_hat + tau dT_o_hat/dt)  compensation "paper" (41); tau = L_q/(R_s + K_pp
//         K_iq)
//                                    + T_d is the loop's lag; the paper's filter has no rate
//         + known voltage loss / K_pp         effects with used_in = model or both, and the EMF
//                                             of their flux
//         + u_ff(theta_m)            compensation "angle_domain" (controller/angle_domain.hpp)
//   MPAC: i_q one step ahead under u_q stays within i_max; where it would not, u_q is the one that
//   lands there. Then +-1 a component and the circle v_dc/sqrt3, d first. u_awu is what was cut
//   off.
//
// u is normalised by K_pp = v_dc/2. State and angle are the filter's; the prediction of MPAC runs
// through the voltages that are still on their way (computation delay). The compensation may change
// while running: p_omega takes over what the feed-forward gave or takes, so u_q does not jump. A
// tick whose inputs are not finite repeats the last command and leaves every state alone.
#pragma once
#include <array>

#include "controller/angle_domain.hpp"
#include "controller/controller.hpp"
#include "controller/lqr_design.hpp"

namespace twinrate {

struct LqrParameters {
  LqrDesignParameters design;
  double i_max = 0, k_awu = 5;
  AngleDomainParameters angle_domain;
  void fields(FieldVisitor& f) {
    design.fields(f);
    f.number("i_max_A", i_max, 1e-3, 1e4, "largest current amplitude (MPAC)", Presence::kRequired);
    f.number("k_awu_rad_s", k_awu, 0, 1e6,
             "anti-windup gain of (39), a unit of normalised voltage");
    f.table("angle_domain", [&](FieldVisitor& sub) { angle_domain.fields(sub); });
  }
};

class Lqr final : public Controller {
 public:
  Lqr(const DriveConfig& config, const LqrParameters& parameters, const LqrDesign& design);
  std::string_view kind() const override { return "lqr"; }
  Command step(const ControllerInput& in) override;
  void know(const Effects& model_effects) override;
  ControllerEvent take_event() override;
  std::string learnt() const override;

 private:
  struct State {
    double theta_e, theta_m, omega_m;
    Vec2 i_dq;
  };
  State state_of(const ControllerInput& in) const;
  void switch_compensation(double t, double T_o);
  Vec2 control_law(const State& x, double T_o);
  Vec2 limit(const State& x, const Vec2& u, double v_dc) const;
  Vec2 with_known_voltage_loss(const Vec2& u, const State& x, const Measurement& m) const;
  Vec2 currents_when_it_acts(const State& x) const;

  const MachineParameters machine_;
  const LqrParameters p_;
  const Vec2 K_d_;
  const Vec3 K_q_;
  const double K_pp_, K_ff_, lead_s_;
  const ControllerChoice compensation_choice_;
  const AngleSource angle_source_;
  const double T_s_, advance_s_, slew_rate_;
  const int delay_;
  AngleDomain angle_domain_;
  Effects known_flux_, known_voltage_;
  Compensation compensation_;
  double p_id_ = 0, p_omega_ = 0, omega_m_ref_ = 0, i_d_ref_ = 0;
  Vec2 u_awu_ = Vec2::Zero();
  std::array<Vec2, 4> pending_{};  // volts in stationary axes, on their way; newest at [0]
  Command command_;
  ControllerEvent event_;
};

}  // namespace twinrate

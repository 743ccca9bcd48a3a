#include "controller/startup.hpp"

namespace twinrate {

Startup::Startup(const StartupParameters& p, bool active, double T_s)
    : p_(p), T_s_(T_s), mode_(active ? Mode::kAlign : Mode::kRun) {}

Startup::Drive Startup::step(const Estimate& e, double omega_e_hat, double direction) {
  Drive drive;
  if (mode_ == Mode::kAlign) {
    theta_e_ = t_in_mode_ < p_.t_align ? kPi / 2 : 0;
    if (t_in_mode_ >= 2 * p_.t_align) {
      mode_ = Mode::kIfRamp;
      t_in_mode_ = 0;
    }
  } else if (mode_ == Mode::kIfRamp) {
    const double target = direction * p_.omega_e_handover;
    omega_e_ = slew(omega_e_, target, p_.acceleration, T_s_);
    theta_e_ = wrap_turn(theta_e_ + omega_e_ * T_s_);
    const bool at_speed = omega_e_ == target;
    const bool agrees = at_speed && std::abs(omega_e_hat - omega_e_) < 0.3 * std::abs(omega_e_) &&
                        std::abs(wrap_pi(e.theta_e - theta_e_)) < 75 * kPi / 180;
    t_agreed_ = agrees ? t_agreed_ + T_s_ : 0;
    if (at_speed) t_at_speed_ += T_s_;
    if (t_agreed_ >= p_.t_agree) {
      mode_ = Mode::kRun;
      drive.handed_over = true;
    } else if (t_at_speed_ > p_.t_give_up) {
      mode_ = Mode::kSafe;
    }
  }
  t_in_mode_ += T_s_;
  drive.mode = mode_;
  drive.theta_e = theta_e_;
  drive.omega_e = omega_e_;
  return drive;
}

ControllerEvent mode_change(Mode mode) {
  switch (mode) {
    case Mode::kRun:
      return {Reason::kModeChange, "hand-over: running on the estimate"};
    case Mode::kIfRamp:
      return {Reason::kModeChange, "alignment done: I/f ramp"};
    case Mode::kSafe:
      return {Reason::kStartupGaveUp, "the estimate did not agree with the I/f ramp: zero voltage"};
    case Mode::kAlign:
      break;
  }
  return {};
}

ForcedCurrent::ForcedCurrent(const MachineParameters& machine, double i_start, double bandwidth_Hz,
                             double T_s)
    : machine_(machine),
      i_start_(i_start),
      T_s_(T_s),
      d_(current_pi(kTwoPi * bandwidth_Hz, machine.R_s, machine.L_d)),
      q_(current_pi(kTwoPi * bandwidth_Hz, machine.R_s, machine.L_q)) {}

Vec2 ForcedCurrent::step(Mode mode, const Vec2& i_dq, double omega_e, double u_max) {
  if (mode == Mode::kAlign) {
    d_.preset(machine_.R_s * i_start_);
    return {machine_.R_s * i_start_, 0};
  }
  const Vec2 error = i_dq_ref() - i_dq;
  const Vec2 cross(-omega_e * machine_.L_q * i_dq[1], omega_e * machine_.L_d * i_dq[0]);
  const Vec2 u = Vec2(d_.output(error[0]), q_.output(error[1])) + cross;
  const Vec2 limited = u.norm() > u_max ? Vec2(u * (u_max / u.norm())) : u;
  d_.update(error[0], u[0], limited[0], T_s_);
  q_.update(error[1], u[1], limited[1], T_s_);
  return limited;
}

}  // namespace twinrate

#include "controller/foc.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "model/effects/undo.hpp"
#include "model/pair.hpp"

namespace twinrate {
namespace {

// Two loads and one store. An assignment loads both numbers together, which waits for two stores
// that made them just before. One store spares the next assignment this wait.
void set(Vec2& to, const Vec2& from) {
  const Pair both = {from[0], from[1]};
  std::memcpy(to.data(), &both, sizeof both);
}

}  // namespace

Foc::Foc(const DriveConfig& config, const FocParameters& parameters)
    : machine_(config.machine),
      p_(parameters),
      angle_source_(config.controller.angle_source),
      choice_(config.controller),
      T_s_(config.T_s()),
      advance_s_((config.plant.delay_samples + 0.5) * config.T_s()),
      slew_rate_(config.reference.slew_rate_rad_s2 / config.machine.n_p),
      lead_s_(1 / (kTwoPi * parameters.current_bandwidth) + advance_s_),
      mechanical_angle_(config.controller.angle_source, config.machine.n_p),
      compensation_(config.controller.compensation_at(0)),
      speed_(speed_pi(kTwoPi * parameters.speed_bandwidth, machine_.J, machine_.torque_constant())),
      current_d_(current_pi(kTwoPi * parameters.current_bandwidth, machine_.R_s, machine_.L_d)),
      current_q_(current_pi(kTwoPi * parameters.current_bandwidth, machine_.R_s, machine_.L_q)),
      field_weakening_(parameters.field_weakening, machine_, parameters.i_max, config.T_s()),
      startup_(parameters.startup, config.start == Start::kAlignIf, config.T_s()) {
  if (config.start == Start::kFlying) omega_m_ref_ = config.omega_m_start();
  know(config.model_effects());
}

void Foc::know(const Effects& model_effects) {
  effects_ = acting_on(model_effects, kOnTorque | kOnFlux);
  on_voltage_ = acting_on(model_effects, kOnVoltage);
}

Foc::Frame Foc::rotor_frame(const ControllerInput& in) const {
  switch (angle_source_) {
    case AngleSource::kEstimate:
      return {in.estimate.theta_e, in.estimate.omega_m};
    case AngleSource::kMeasured:
      return {wrap_turn(machine_.n_p * in.measurement.theta_m), in.measurement.omega_m};
    case AngleSource::kTruth:
      return {wrap_turn(machine_.n_p * in.truth->theta_m), in.truth->omega_m};
  }
  return {};
}

double Foc::predicted_load(const ControllerInput& in, const Frame& frame) const {
  if (!p_.compensate_effects) return 0;
  return known_load(effects_,
                    {.t = 1e-9 * static_cast<double>(in.measurement.t_ns),
                     .i_dq = in.estimate.i_dq,
                     .omega_m = frame.omega_m,
                     .theta_m = frame.theta_m,
                     .theta_e = frame.theta_e},
                    machine_.n_p);
}

// Additional voltage requested from the inverter, so that `u_dq` reaches the machine.
Vec2 Foc::predicted_voltage_loss(const ControllerInput& in, const Frame& frame,
                                 const Vec2& u_dq) const {
  if (!p_.compensate_effects || on_voltage_.empty()) return Vec2::Zero();
  return predicted_drop(on_voltage_, {.t = 1e-9 * static_cast<double>(in.measurement.t_ns),
                                      .i_dq = park(clarke(in.measurement.i_abc), frame.theta_e),
                                      .u_dq = u_dq,
                                      .v_dc = in.measurement.v_dc,
                                      .omega_m = frame.omega_m,
                                      .theta_m = frame.theta_m,
                                      .theta_e = frame.theta_e});
}

double Foc::load_current(const ControllerInput& in, const Frame& frame) {
  const bool at_mtpa = p_.current_angle == CurrentAngle::kMtpa;
  const double T_load = in.estimate.T_load + lead_s_ * in.estimate.dT_load_dt;
  const auto fed = [&](Compensation c) {
    if (!feeds_load(c)) return predicted_load(in, frame) / machine_.torque_constant();
    return at_mtpa ? mtpa_for_torque(machine_, T_load) : T_load / machine_.torque_constant();
  };
  const auto wanted = choice_.compensation_at(1e-9 * static_cast<double>(in.measurement.t_ns));
  if (wanted != compensation_) {
    speed_.preset(speed_.integral() + fed(compensation_) - fed(wanted));
    compensation_ = wanted;
    event_ = {Reason::kModeChange,
              feeds_load(wanted) ? "compensation: estimated load fed forward" : "compensation off"};
  }
  return fed(compensation_);
}

// The current reference; the speed loop takes a step every speed_divider ticks.
Vec2 Foc::closed_loop_reference(const ControllerInput& in, const Frame& frame) {
  omega_m_ref_ = slew(omega_m_ref_, in.reference.omega_m_ref, slew_rate_, T_s_);
  i_d_handover_ *= std::max(0.0, 1 - T_s_ / p_.startup.t_fade);
  const auto limited = [this] {
    return limit_current(i_dq_wanted_, field_weakening_.i_d(), i_d_handover_, p_.i_max);
  };
  const bool due = speed_ticks_ == 0;
  speed_ticks_ = (speed_ticks_ + 1) % p_.speed_divider;
  if (!due) return limited();
  const bool at_mtpa = p_.current_angle == CurrentAngle::kMtpa;
  const double error = omega_m_ref_ - frame.omega_m, fed = load_current(in, frame);
  const double I_s = speed_.output(error) + fed;
  const double I_s_limited = std::clamp(I_s, -p_.i_max, p_.i_max);
  i_dq_wanted_ = at_mtpa ? mtpa(machine_, I_s_limited) : Vec2(0, I_s);
  i_dq_wanted_[0] += in.reference.i_d_ref;
  const Vec2 i_dq = limited();
  const double passed_on = at_mtpa ? mtpa_amplitude(machine_, i_dq[1]) : i_dq[1];
  speed_.update(error, I_s, passed_on, p_.speed_divider * T_s_);
  return i_dq;
}

Vec2 Foc::feed_forward(const Vec2& i_dq, double omega_e) const {
  if (!p_.decoupling) return Vec2::Zero();
  return {-omega_e * machine_.L_q * i_dq[1], omega_e * (machine_.L_d * i_dq[0] + machine_.psi_f)};
}

Vec2 Foc::current_loop(const Vec2& i_dq_ref, const Vec2& i_dq, double omega_e, double v_dc) {
  const double error_d = i_dq_ref[0] - i_dq[0], error_q = i_dq_ref[1] - i_dq[1];
  const Vec2 forward = feed_forward(i_dq, omega_e);
  const double u_d = current_d_.output(error_d) + forward[0];
  const double u_q = current_q_.output(error_q) + forward[1];
  const double u_max = v_dc * std::numbers::inv_sqrt3, amplitude = std::sqrt(u_d * u_d + u_q * u_q);
  const double share = amplitude > u_max ? u_max / amplitude : 1;
  const double u_d_limited = u_d * share, u_q_limited = u_q * share;
  current_d_.update(error_d, u_d, u_d_limited, T_s_);
  current_q_.update(error_q, u_q, u_q_limited, T_s_);
  field_weakening_.update(amplitude, u_max, omega_e);
  return {u_d_limited, u_q_limited};
}

ControllerEvent Foc::take_event() {
  return std::exchange(event_, {});
}

bool Foc::finite(const ControllerInput& in, const Frame& frame) const {
  return in.measurement.i_abc.allFinite() && std::isfinite(in.measurement.v_dc) &&
         std::isfinite(frame.theta_e) && std::isfinite(frame.omega_m) &&
         std::isfinite(in.estimate.theta_e) && std::isfinite(in.estimate.omega_m) &&
         (!feeds_load(compensation_) || std::isfinite(in.estimate.T_load));
}

// Bumpless: the same voltage and current vectors, seen from the estimated rotor frame.
void Foc::hand_over(const ControllerInput& in, const Frame& frame, double theta_e_forced) {
  const Vec2 i_dq = park(clarke(in.measurement.i_abc), frame.theta_e);
  const Vec2 integral = rotate(u_dq_, theta_e_forced - frame.theta_e) -
                        feed_forward(i_dq, machine_.n_p * frame.omega_m);
  current_d_.preset(integral[0]);
  current_q_.preset(integral[1]);
  const bool at_mtpa = p_.current_angle == CurrentAngle::kMtpa;
  const double I_s = at_mtpa ? mtpa_amplitude(machine_, i_dq[1]) : i_dq[1];
  i_d_handover_ = i_dq[0] - in.reference.i_d_ref - (at_mtpa ? mtpa(machine_, I_s)[0] : 0);
  omega_m_ref_ = frame.omega_m;
  speed_.preset(I_s - load_current(in, frame));
  speed_ticks_ = 0;
}

Mode Foc::advance_mode(const ControllerInput& in, Frame& frame) {
  const Mode mode_before = startup_.mode();
  const Startup::Drive drive = startup_.step(in.estimate, machine_.n_p * in.estimate.omega_m,
                                             in.reference.omega_m_ref < 0 ? -1.0 : 1.0);
  if (drive.mode != mode_before) event_ = mode_change(drive.mode);
  if (drive.handed_over) {
    hand_over(in, frame, drive.theta_e);
  } else if (drive.mode == Mode::kAlign || drive.mode == Mode::kIfRamp) {
    frame = {drive.theta_e, drive.omega_e / machine_.n_p, frame.theta_m};
  }
  return drive.mode;
}

Vec2 Foc::voltage(const ControllerInput& in, const Frame& frame, Command& c) {
  const double i_start = p_.startup.i_start > 0 ? std::min(p_.startup.i_start, p_.i_max) : p_.i_max;
  const double omega_e = machine_.n_p * frame.omega_m, v_dc = in.measurement.v_dc;
  switch (c.mode) {
    case Mode::kRun: {
      set(c.i_dq_ref, closed_loop_reference(in, frame));
      const Vec2 u_dq = current_loop(c.i_dq_ref, c.i_dq, omega_e, v_dc);
      const Vec2 loss = predicted_voltage_loss(in, frame, u_dq);
      return {u_dq[0] + loss[0], u_dq[1] + loss[1]};
    }
    case Mode::kAlign:
      c.i_dq_ref = {i_start, 0};
      current_d_.preset(machine_.R_s * i_start);
      return {machine_.R_s * i_start, 0};
    case Mode::kIfRamp:
      c.i_dq_ref = {i_start, 0};
      return current_loop(c.i_dq_ref, c.i_dq, omega_e, v_dc);
    case Mode::kSafe:
      break;  // zero voltage: the motor brakes on its own resistance
  }
  return Vec2::Zero();
}

[[gnu::flatten]] Command Foc::step(const ControllerInput& in) {
  const Measurement& m = in.measurement;
  Frame frame = rotor_frame(in);
  if (!finite(in, frame)) {
    command_.k = m.k;
    command_.t_ns = m.t_ns;
    return command_;
  }
  frame.theta_m = mechanical_angle_.step(in, frame.theta_e);
  Command c;
  c.k = m.k;
  c.t_ns = m.t_ns;
  c.mode = advance_mode(in, frame);
  c.theta_ctrl = frame.theta_e;
  set(c.i_dq, park(clarke(m.i_abc), frame.theta_e));
  set(u_dq_, voltage(in, frame, c));
  const double omega_e = machine_.n_p * frame.omega_m;
  set(c.u_alphabeta_ref, inverse_park(u_dq_, frame.theta_e + advance_s_ * omega_e));
  c.omega_m_ref = c.mode == Mode::kRun ? omega_m_ref_ : frame.omega_m;
  command_ = c;
  return c;
}

}  // namespace twinrate

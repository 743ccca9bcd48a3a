#include "controller/lqr.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/config_write.hpp"
#include "model/effects/flux_map.hpp"
#include "model/effects/undo.hpp"
#include "model/point_of.hpp"

namespace twinrate {
namespace {

LoopModel loop_model(const DriveConfig& c, const LqrDesign& d) {
  return {.R_s = c.machine.R_s,
          .L_q = c.machine.L_q,
          .K_t = c.machine.torque_constant(),
          .J = c.machine.J,
          .B = c.machine.B,
          .K_pp = d.K_pp,
          .K_iq = d.q.K[0],
          .K_omega = d.q.K[1],
          .K_p = d.q.K[2],
          .T_d = (c.plant.delay_samples + 0.5) * c.T_s()};
}

constexpr const char* kSwitched[] = {"compensation off", "compensation: estimated load fed forward",
                                     "compensation: learnt over the angle"};

}  // namespace

Lqr::Lqr(const DriveConfig& config, const LqrParameters& parameters, const LqrDesign& design)
    : machine_(config.machine),
      p_(parameters),
      K_d_(design.d.K.transpose()),
      K_q_(design.q.K.transpose()),
      K_pp_(design.K_pp),
      K_ff_(design.K_ff),
      lead_s_(machine_.L_q / (machine_.R_s + design.K_pp * design.q.K[0]) +
              (config.plant.delay_samples + 0.5) * config.T_s()),
      compensation_choice_(config.controller),
      angle_source_(config.controller.angle_source),
      T_s_(config.T_s()),
      advance_s_((config.plant.delay_samples + 0.5) * config.T_s()),
      slew_rate_(config.reference.slew_rate_rad_s2 / config.machine.n_p),
      delay_(config.plant.delay_samples),
      angle_domain_(parameters.angle_domain, loop_model(config, design), config.T_s()),
      compensation_(config.controller.compensation_at(0)) {
  pending_.fill(Vec2::Zero());
  if (config.start == Start::kFlying) omega_m_ref_ = config.omega_m_start();
  know(config.model_effects());
}

void Lqr::know(const Effects& model_effects) {
  known_flux_ = acting_on(model_effects, kOnFlux);
  known_voltage_ = acting_on(model_effects, kOnVoltage | kOnFlux);
}

Lqr::State Lqr::state_of(const ControllerInput& in) const {
  const double theta_m = in.measurement.theta_m;
  switch (angle_source_) {
    case AngleSource::kEstimate:
      return {in.estimate.theta_e, theta_m, in.estimate.omega_m, in.estimate.i_dq};
    case AngleSource::kMeasured: {
      const double theta_e = wrap_turn(machine_.n_p * theta_m);
      return {theta_e, theta_m, in.measurement.omega_m,
              park(clarke(in.measurement.i_abc), theta_e)};
    }
    case AngleSource::kTruth: {
      const double theta_e = wrap_turn(machine_.n_p * in.truth->theta_m);
      return {theta_e, in.truth->theta_m, in.truth->omega_m,
              park(clarke(in.measurement.i_abc), theta_e)};
    }
  }
  return {};
}

void Lqr::switch_compensation(double t, double T_o) {
  const auto wanted = compensation_choice_.compensation_at(t);
  if (wanted == compensation_) return;
  const auto fed_forward = [&](Compensation c) {
    return c == Compensation::kPaper ? K_ff_ * T_o : 0.0;
  };
  p_omega_ += (fed_forward(compensation_) - fed_forward(wanted)) / K_q_[2];
  compensation_ = wanted;
  angle_domain_.restart();
  event_ = {Reason::kModeChange, kSwitched[static_cast<int>(wanted)]};
}

Vec2 Lqr::control_law(const State& x, double T_o) {
  p_id_ += T_s_ * (x.i_dq[0] - i_d_ref_ - p_.k_awu * u_awu_[0]);
  p_omega_ += T_s_ * (x.omega_m - omega_m_ref_ - p_.k_awu * u_awu_[1]);
  const double omega_e = machine_.n_p * x.omega_m;
  double u_d = -K_d_.dot(Vec2(x.i_dq[0], p_id_));
  double u_q = -K_q_.dot(Vec3(x.i_dq[1], x.omega_m, p_omega_));
  if (compensation_ == Compensation::kPaper) u_q -= K_ff_ * T_o;
  if (compensation_ == Compensation::kAngleDomain)
    u_q += angle_domain_.step(x.theta_m, omega_m_ref_);
  u_d -= omega_e * machine_.L_q * x.i_dq[1] / K_pp_;
  u_q += omega_e * (machine_.L_d * x.i_dq[0] + machine_.psi_f) / K_pp_;
  return {u_d, u_q};
}

Vec2 Lqr::with_known_voltage_loss(const Vec2& u, const State& x, const Measurement& m) const {
  if (known_voltage_.empty()) return u;
  OperatingPoint point =
      point_of(m, {.omega_m = x.omega_m, .theta_m = x.theta_m, .theta_e = x.theta_e});
  point.i_dq = x.i_dq;
  point.u_dq = K_pp_ * u;
  const auto loss = [&] { return predicted_drop_and_emf(known_voltage_, point, machine_.n_p); };
  point.u_dq += loss();  // a loss proportional to the request reduces the addition, too
  return u + loss() / K_pp_;
}

// The currents at the moment the voltage of this tick begins to act.
Vec2 Lqr::currents_when_it_acts(const State& x) const {
  const double omega_e = machine_.n_p * x.omega_m;
  Vec2 i = x.i_dq;
  for (int step = 0; step < delay_; ++step) {
    const Vec2 u = park(pending_[static_cast<std::size_t>(delay_ - 1 - step)],
                        x.theta_e + (step + 0.5) * T_s_ * omega_e);
    i += T_s_ *
         Vec2((u[0] - machine_.R_s * i[0] + omega_e * machine_.L_q * i[1]) / machine_.L_d,
              (u[1] - machine_.R_s * i[1] - omega_e * (machine_.L_d * i[0] + machine_.psi_f)) /
                  machine_.L_q);
  }
  return i;
}

Vec2 Lqr::limit(const State& x, const Vec2& u, double v_dc) const {
  const double omega_e = machine_.n_p * x.omega_m;
  const Vec2 i = currents_when_it_acts(x);
  const double i_q_max = std::sqrt(std::max(0.0, p_.i_max * p_.i_max - i[0] * i[0]));
  // The u_q that lands i_q on a given value one step on.
  const auto u_landing = [&](double i_q) {
    return ((i_q - i[1]) * machine_.L_q / T_s_ + machine_.R_s * i[1] +
            omega_e * (machine_.L_d * i[0] + machine_.psi_f)) /
           K_pp_;
  };
  const double u_circle = v_dc * std::numbers::inv_sqrt3 / K_pp_;
  const double u_d = std::clamp(u[0], -std::min(1.0, u_circle), std::min(1.0, u_circle));
  const double u_q_max = std::min(1.0, std::sqrt(u_circle * u_circle - u_d * u_d));
  double u_q = std::clamp(u[1], u_landing(-i_q_max), u_landing(i_q_max));
  return {u_d, std::clamp(u_q, -u_q_max, u_q_max)};
}

Command Lqr::step(const ControllerInput& in) {
  const Measurement& m = in.measurement;
  const State x = state_of(in);
  const bool finite = std::isfinite(x.theta_e) && std::isfinite(x.omega_m) &&
                      std::isfinite(x.theta_m) && x.i_dq.allFinite() &&
                      std::isfinite(in.estimate.T_load) && std::isfinite(m.v_dc);
  if (!finite) {
    command_.k = m.k;
    command_.t_ns = m.t_ns;
    return command_;
  }
  // Torque that known flux takes is load to a controller that counts on the machine's own.
  const double T_o = in.estimate.T_load + lead_s_ * in.estimate.dT_load_dt +
                     flux_load(machine_.n_p, sum_at(known_flux_, {.i_dq = x.i_dq}).psi_dq, x.i_dq);
  switch_compensation(1e-9 * static_cast<double>(m.t_ns), T_o);
  omega_m_ref_ = slew(omega_m_ref_, in.reference.omega_m_ref, slew_rate_, T_s_);
  i_d_ref_ = in.reference.i_d_ref;
  const Vec2 u_wanted = with_known_voltage_loss(control_law(x, T_o), x, m);
  const Vec2 u = limit(x, u_wanted, m.v_dc);
  u_awu_ = u - u_wanted;

  Command c;
  c.k = m.k;
  c.t_ns = m.t_ns;
  c.theta_ctrl = x.theta_e;
  c.i_dq = x.i_dq;
  c.i_dq_ref = {i_d_ref_, c.i_dq[1]};  // state feedback has no reference of i_q
  c.omega_m_ref = omega_m_ref_;
  c.u_alphabeta_ref = inverse_park(K_pp_ * u, x.theta_e + advance_s_ * machine_.n_p * x.omega_m);
  std::shift_right(pending_.begin(), pending_.end(), 1);
  pending_[0] = c.u_alphabeta_ref;
  command_ = c;
  return c;
}

ControllerEvent Lqr::take_event() {
  return std::exchange(event_, {});
}

std::string Lqr::learnt() const {
  if (angle_domain_.blocks() == 0) return "";
  AngleDomainParameters table = angle_domain_.learnt();
  return write_table("controller.lqr.angle_domain", [&](FieldVisitor& f) { table.fields(f); });
}

}  // namespace twinrate

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

// Square of the least share of i_max that remains for i_q.
constexpr double kLeastTorqueCurrent = 0.1 * 0.1;
constexpr const char* kSwitched[] = {"compensation off", "compensation: estimated load fed forward",
                                     "compensation: learnt over the angle",
                                     "compensation: estimated load fed forward"};

// The current of alignment and ramp: 0 means i_max.
double i_start(const LqrParameters& p) {
  return p.startup.i_start > 0 ? std::min(p.startup.i_start, p.i_max) : p.i_max;
}

// Gains of the q axis over i_d: the same design on a rotor with the flux that i_d leaves.
std::vector<Vec3> gains_over_i_d(const DriveConfig& c, const LqrParameters& p, int points) {
  std::vector<Vec3> gains;
  if (c.machine.L_d == c.machine.L_q || p.design.gains == GainSource::kGiven) return gains;
  for (int i = 0; i < points; ++i) {
    MachineParameters m = c.machine;
    const double i_d = -p.i_max * (1 - static_cast<double>(i) / (points - 1));
    m.psi_f = std::max(0.2 * m.psi_f, m.psi_f + (m.L_d - m.L_q) * i_d);
    const LqrDesign d = design_lqr(m, c.inverter.v_dc, c.T_s(), p.design);
    if (!d.q.complaints.empty()) return {};
    gains.push_back(d.q.K.transpose());
  }
  return gains;
}

}  // namespace

Lqr::Lqr(const DriveConfig& config, const LqrParameters& parameters, const LqrDesign& design)
    : machine_(config.machine),
      p_(parameters),
      K_d_(design.d.K.transpose()),
      K_q_(design.q.K.transpose()),
      K_q_of_i_d_(gains_over_i_d(config, parameters, kOperatingPoints)),
      K_pp_(design.K_pp),
      R_s_K_pp_(machine_.R_s / design.K_pp),
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
      mechanical_angle_(config.controller.angle_source, config.machine.n_p),
      field_weakening_(parameters.field_weakening, machine_, parameters.i_max, config.T_s()),
      startup_(parameters.startup, config.start == Start::kAlignIf, config.T_s()),
      forced_(machine_, i_start(parameters), config.rates.f_s_Hz / 25, config.T_s()),
      share_(
          std::min(1.0, T_s_ * (machine_.R_s + design.K_pp * design.q.K[0]) / (5 * machine_.L_q))),
      flying_(config.start == Start::kFlying),
      compensation_(config.controller.compensation_at(0)) {
  pending_.fill(Vec2::Zero());
  know(config.model_effects());
}

void Lqr::know(const Effects& model_effects) {
  known_flux_ = acting_on(model_effects, kOnFlux);
  known_voltage_ = acting_on(model_effects, kOnVoltage | kOnFlux);
}

Lqr::State Lqr::state_of(const ControllerInput& in) {
  const double theta_m = mechanical_angle_.step(in, in.estimate.theta_e);
  switch (angle_source_) {
    case AngleSource::kEstimate:
      return {in.estimate.theta_e, theta_m, in.estimate.omega_m, in.estimate.i_dq};
    case AngleSource::kMeasured: {
      const double theta_e = wrap_turn(machine_.n_p * in.measurement.theta_m);
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
  const auto fed_forward = [&](Compensation c) { return feeds_load(c) ? K_ff_ * T_o : 0.0; };
  p_omega_ += (fed_forward(compensation_) - fed_forward(wanted)) / K_q_[2];
  compensation_ = wanted;
  angle_domain_.restart();
  event_ = {Reason::kModeChange, kSwitched[static_cast<int>(wanted)]};
}

double Lqr::i_d_wanted(const ControllerInput& in) const {
  const double at_mtpa = p_.current_angle == CurrentAngle::kMtpa
                             ? mtpa(machine_, mtpa_amplitude(machine_, i_q_slow_))[0]
                             : 0;
  return std::clamp(in.reference.i_d_ref + at_mtpa + field_weakening_.i_d() + i_d_handover_,
                    -p_.i_max, p_.i_max);
}

void Lqr::schedule_gains(const State& x) {
  if (K_q_of_i_d_.empty()) return;
  const double at = std::clamp(1 + i_d_ref_ / p_.i_max, 0.0, 1.0) * (kOperatingPoints - 1);
  const auto node = std::min(static_cast<std::size_t>(at), K_q_of_i_d_.size() - 2);
  const double share = at - static_cast<double>(node);
  const Vec3 K = (1 - share) * K_q_of_i_d_[node] + share * K_q_of_i_d_[node + 1];
  const Vec2 fast(x.i_dq[1], x.omega_m);
  p_omega_ = (K_q_.dot(Vec3(fast[0], fast[1], p_omega_)) - K.head<2>().dot(fast)) / K[2];
  K_q_ = K;
  const double psi = machine_.psi_f + (machine_.L_d - machine_.L_q) * i_d_ref_;
  K_ff_ = -(R_s_K_pp_ + K[0]) / (machine_.torque_constant() * std::max(0.2, psi / machine_.psi_f));
}

Vec2 Lqr::law_without_integrals(const State& x, double T_o) const {
  const double omega_e = machine_.n_p * x.omega_m;
  double u_d = -K_d_[0] * x.i_dq[0] + (K_d_[0] + R_s_K_pp_) * i_d_ref_;
  double u_q = -K_q_.head<2>().dot(Vec2(x.i_dq[1], x.omega_m));
  if (feeds_load(compensation_)) u_q -= K_ff_ * T_o;
  u_d -= omega_e * machine_.L_q * x.i_dq[1] / K_pp_;
  u_q += omega_e * (machine_.L_d * x.i_dq[0] + machine_.psi_f) / K_pp_;
  return {u_d, u_q};
}

void Lqr::take_over(const ControllerInput& in, const State& x, const Vec2& u, double T_o) {
  i_q_slow_ = x.i_dq[1];
  i_d_ref_ = x.i_dq[0];
  omega_m_ref_ = x.omega_m;
  schedule_gains(x);
  const Vec2 integral = law_without_integrals(x, T_o) - u;
  p_id_ = integral[0] / K_d_[1];
  p_omega_ = integral[1] / K_q_[2];
  u_awu_.setZero();
  i_d_handover_ = 0;
  i_d_handover_ = i_d_ref_ - i_d_wanted(in);
}

Vec2 Lqr::holding_voltage(const State& x) const {
  const double omega_e = machine_.n_p * x.omega_m;
  return Vec2(machine_.R_s * x.i_dq[0] - omega_e * machine_.L_q * x.i_dq[1],
              machine_.R_s * x.i_dq[1] + omega_e * (machine_.L_d * x.i_dq[0] + machine_.psi_f)) /
         K_pp_;
}

Vec2 Lqr::control_law(const State& x, double T_o) {
  p_id_ += T_s_ * (x.i_dq[0] - i_d_ref_ - p_.k_awu * u_awu_[0]);
  p_omega_ += T_s_ * (x.omega_m - omega_m_ref_ - p_.k_awu * u_awu_[1]);
  const double omega_e = machine_.n_p * x.omega_m;
  double u_d = -K_d_.dot(Vec2(x.i_dq[0], p_id_)) + (K_d_[0] + R_s_K_pp_) * i_d_ref_;
  double u_q = -K_q_.dot(Vec3(x.i_dq[1], x.omega_m, p_omega_));
  if (feeds_load(compensation_)) u_q -= K_ff_ * T_o;
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
  const double left = p_.i_max * p_.i_max - i[0] * i[0];
  const double i_q_max = std::sqrt(std::max(left, kLeastTorqueCurrent * p_.i_max * p_.i_max));
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

Mode Lqr::advance_mode(const ControllerInput& in, const State& x, double T_o) {
  const Mode before = startup_.mode();
  drive_ = startup_.step(in.estimate, machine_.n_p * in.estimate.omega_m,
                         in.reference.omega_m_ref < 0 ? -1.0 : 1.0);
  if (drive_.mode != before) event_ = mode_change(drive_.mode);
  if (drive_.handed_over)
    take_over(in, x, rotate(u_forced_, drive_.theta_e - x.theta_e) / K_pp_, T_o);
  else if (flying_)
    take_over(in, x, holding_voltage(x), T_o);
  flying_ = false;
  return drive_.mode;
}

void Lqr::keep(const Command& c) {
  std::shift_right(pending_.begin(), pending_.end(), 1);
  pending_[0] = c.u_alphabeta_ref;
  command_ = c;
}

Command Lqr::forced(const ControllerInput& in, Mode mode) {
  Command c;
  c.k = in.measurement.k;
  c.t_ns = in.measurement.t_ns;
  c.mode = mode;
  c.theta_ctrl = drive_.theta_e;
  c.i_dq = park(clarke(in.measurement.i_abc), drive_.theta_e);
  c.omega_m_ref = drive_.omega_e / machine_.n_p;
  u_forced_.setZero();
  if (mode != Mode::kSafe) {
    c.i_dq_ref = forced_.i_dq_ref();
    u_forced_ =
        forced_.step(mode, c.i_dq, drive_.omega_e, in.measurement.v_dc * std::numbers::inv_sqrt3);
  }
  c.u_alphabeta_ref = inverse_park(u_forced_, drive_.theta_e + advance_s_ * drive_.omega_e);
  return c;
}

Command Lqr::run(const ControllerInput& in, const State& x, double T_o) {
  const Measurement& m = in.measurement;
  switch_compensation(1e-9 * static_cast<double>(m.t_ns), T_o);
  omega_m_ref_ = slew(omega_m_ref_, in.reference.omega_m_ref, slew_rate_, T_s_);
  i_q_slow_ += share_ * (x.i_dq[1] - i_q_slow_);
  i_d_ref_ = i_d_wanted(in);
  i_d_handover_ *= std::max(0.0, 1 - T_s_ / p_.startup.t_fade);
  schedule_gains(x);
  const Vec2 u_wanted = with_known_voltage_loss(control_law(x, T_o), x, m);
  const Vec2 u = limit(x, u_wanted, m.v_dc);
  u_awu_ = u - u_wanted;
  const double omega_e = machine_.n_p * x.omega_m;
  field_weakening_.update(K_pp_ * u_wanted.norm(), m.v_dc * std::numbers::inv_sqrt3, omega_e);

  Command c;
  c.k = m.k;
  c.t_ns = m.t_ns;
  c.theta_ctrl = x.theta_e;
  c.i_dq = x.i_dq;
  c.i_dq_ref = {i_d_ref_, c.i_dq[1]};  // state feedback has no reference of i_q
  c.omega_m_ref = omega_m_ref_;
  c.u_alphabeta_ref = inverse_park(K_pp_ * u, x.theta_e + advance_s_ * omega_e);
  return c;
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
  const Mode mode = advance_mode(in, x, T_o);
  const Command c = mode == Mode::kRun ? run(in, x, T_o) : forced(in, mode);
  keep(c);
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

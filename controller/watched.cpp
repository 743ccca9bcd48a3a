#include "controller/watched.hpp"

#include <algorithm>
#include <numbers>
#include <utility>

namespace twinrate {
namespace {

double i_start(const WatchParameters& p) {
  return p.startup.i_start > 0 ? std::min(p.startup.i_start, p.i_max) : p.i_max;
}

}  // namespace

Watched::Watched(std::unique_ptr<Controller> inner, const DriveConfig& config,
                 const WatchParameters& p)
    : inner_(std::move(inner)),
      machine_(config.machine),
      p_(p),
      T_s_(config.T_s()),
      advance_s_((config.plant.delay_samples + 0.5) * config.T_s()),
      synchronism_(p.synchronism, machine_, config.T_s()),
      forced_(machine_, i_start(p), config.rates.f_s_Hz / 25, config.T_s()) {}

bool Watched::lost(const ControllerInput& in) {
  const Measurement& m = in.measurement;
  const Estimate& e = in.estimate;
  if (e.status & kMeasuredAngle) return false;  // of a sensor: it cannot be lost
  const double omega_e = machine_.n_p * e.omega_m;
  return synchronism_.lost(e, park(clarke(m.i_abc), e.theta_e),
                           park(m.u_alphabeta, e.theta_e - 0.5 * T_s_ * omega_e), omega_e);
}

void Watched::begin_stop(const Estimate& e) {
  const double most = p_.startup.omega_e_handover;
  theta_e_ = e.theta_e;
  omega_e_ = std::clamp(machine_.n_p * e.omega_m, -most, most);
  mode_ = Mode::kIfRamp;
}

Command Watched::stopping(const ControllerInput& in) {
  Command c;
  c.k = in.measurement.k;
  c.t_ns = in.measurement.t_ns;
  if (mode_ == Mode::kIfRamp) {
    omega_e_ = slew(omega_e_, 0, p_.startup.acceleration, T_s_);
    theta_e_ = wrap_turn(theta_e_ + omega_e_ * T_s_);
    if (omega_e_ == 0) t_standing_ += T_s_;
    if (t_standing_ > p_.startup.t_align) mode_ = Mode::kSafe;
  }
  c.mode = mode_;
  if (mode_ == Mode::kSafe) return c;
  c.theta_ctrl = theta_e_;
  c.i_dq = park(clarke(in.measurement.i_abc), theta_e_);
  c.i_dq_ref = forced_.i_dq_ref();
  c.omega_m_ref = omega_e_ / machine_.n_p;
  const double u_max = in.measurement.v_dc * std::numbers::inv_sqrt3;
  const Vec2 u_dq = forced_.step(mode_, c.i_dq, omega_e_, u_max);
  c.u_alphabeta_ref = inverse_park(u_dq, theta_e_ + advance_s_ * omega_e_);
  return c;
}

Command Watched::step(const ControllerInput& in) {
  if (lost_) return stopping(in);
  const Command c = inner_->step(in);
  if (c.mode != Mode::kRun) {
    synchronism_.reset();
    return c;
  }
  if (!lost(in)) return c;
  lost_ = true;
  const bool stops = p_.synchronism.reaction == SyncLost::kStop;
  if (stops) begin_stop(in.estimate);
  event_ = {Reason::kLostSynchronism, synchronism_.text(stops)};
  return stopping(in);
}

ControllerEvent Watched::take_event() {
  const ControllerEvent inner = inner_->take_event();
  return event_.reason != Reason::kNone ? std::exchange(event_, {}) : inner;
}

}  // namespace twinrate

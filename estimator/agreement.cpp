#include "estimator/agreement.hpp"

#include <cmath>

namespace twinrate {

void Agreement::reset() {
  agreed_ = has_sample_ = false;
  begin_turn();
}

void Agreement::begin_turn() {
  turned_ = expected_ = 0;
  emf_.setZero();
  unexplained_.setZero();
}

void Agreement::add(const Estimate& e, const Vec2& i, const Vec2& u_alphabeta) {
  const MachineParameters& m = machine_;
  const double change = wrap_pi(e.theta_e - theta_e_before_);
  const double theta_mid = theta_e_before_ + 0.5 * change;
  const Vec2 emf = u_alphabeta - 0.5 * m.R_s * (i + i_before_) - m.L_q / T_s_ * (i - i_before_);
  const Vec2 innov = innov_turns_ ? park(e.innov.head<2>(), e.theta_e) : Vec2(e.innov.head<2>());
  const double i_d = 0.5 * park(i + i_before_, theta_mid)[0];
  emf_ += park(emf, theta_mid);
  unexplained_ += Vec2(m.L_d * innov[0], m.L_q * innov[1]) / T_s_;
  expected_ += m.n_p * e.omega_m * (m.psi_f + (m.L_d - m.L_q) * i_d);
  turned_ += change;
}

bool Agreement::agrees() const {
  const double limit = kResidualMax * std::abs(expected_);
  return (emf_ - Vec2(0, expected_)).norm() <= limit && unexplained_.norm() <= limit;
}

bool Agreement::step(const Estimate& e, const Measurement& m) {
  if (agreed_ || e.status & kMeasuredAngle) return agreed_ = true;
  const Vec2 i = clarke(m.i_abc);
  const bool usable = m.mode == Mode::kRun && !(e.status & (kNotFinite | kGapBridged));
  if (usable && has_sample_)
    add(e, i, m.u_alphabeta);
  else
    begin_turn();
  has_sample_ = usable;
  i_before_ = i;
  theta_e_before_ = e.theta_e;
  if (!std::isfinite(turned_)) begin_turn();
  if (std::abs(turned_) < kTwoPi) return false;
  agreed_ = agrees();
  begin_turn();
  return agreed_;
}

}  // namespace twinrate

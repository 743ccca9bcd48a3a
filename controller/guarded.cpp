#include "controller/guarded.hpp"

#include <cmath>
#include <utility>

namespace twinrate {
namespace {

// One sum of squares: not finite if one of them is not.
bool finite(const Measurement& m) {
  return std::isfinite(m.i_abc.squaredNorm() + m.v_dc * m.v_dc);
}

bool finite(const Estimate& e) {
  return std::isfinite(e.theta_e * e.theta_e + e.omega_m * e.omega_m + e.i_dq.squaredNorm() +
                       e.T_load * e.T_load);
}

bool finite(const Command& c) {
  return std::isfinite(c.u_alphabeta_ref.squaredNorm() + c.i_dq_ref.squaredNorm() +
                       c.i_dq.squaredNorm() + c.theta_ctrl * c.theta_ctrl +
                       c.omega_m_ref * c.omega_m_ref);
}

}  // namespace

Command Guarded::safe(const ControllerInput& in) const {
  Command c;
  c.k = in.measurement.k;
  c.t_ns = in.measurement.t_ns;
  c.mode = Mode::kSafe;
  return c;
}

Command Guarded::step(const ControllerInput& in) {
  if (tripped_) return safe(in);
  bad_inputs_ = finite(in.measurement) && finite(in.estimate) ? 0 : bad_inputs_ + 1;
  const Command c = inner_->step(in);
  if (bad_inputs_ > kHoldTicks)
    event_ = {Reason::kInputNotFinite, finite(in.estimate)
                                           ? "the measurement is not finite: zero voltage"
                                           : "the estimate is not finite: zero voltage"};
  else if (!finite(c))
    event_ = {Reason::kCommandNotFinite, "the command is not finite: zero voltage"};
  else
    return c;
  tripped_ = true;
  return safe(in);
}

ControllerEvent Guarded::take_event() {
  const ControllerEvent inner = inner_->take_event();
  return event_.reason != Reason::kNone ? std::exchange(event_, {}) : inner;
}

}  // namespace twinrate

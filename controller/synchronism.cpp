#include "controller/synchronism.hpp"

#include <algorithm>

#include "model/math.hpp"

namespace twinrate {

Synchronism::Synchronism(const SynchronismParameters& p, const MachineParameters& machine,
                         double T_s)
    : p_(p), machine_(machine), T_s_(T_s), share_(1 - math::exp(-kTwoPi * p.lowpass_Hz * T_s)) {}

void Synchronism::reset() {
  residual_.setZero();
  innov2_ = share_of_emf_ = r_ = t_beyond_ = t_within_ = 0;
  found_ = false;
}

const char* Synchronism::text(bool stops) const {
  if (stops)
    return by_emf() ? "the EMF does not agree with the estimate: controlled stop"
                    : "the innovations are too large: controlled stop";
  return by_emf() ? "the EMF does not agree with the estimate: zero voltage"
                  : "the innovations are too large: zero voltage";
}

bool Synchronism::lost(const Estimate& e, const Vec2& i_dq, const Vec2& u_dq, double omega_e) {
  if (!p_.watch) return false;
  const MachineParameters& m = machine_;
  const Vec2 emf(u_dq[0] - m.R_s * i_dq[0] + omega_e * m.L_q * i_dq[1],
                 u_dq[1] - m.R_s * i_dq[1] - omega_e * (m.L_d * i_dq[0] + m.psi_f));
  residual_ += share_ * (emf - residual_);
  innov2_ += share_ * (e.innov.head<2>().squaredNorm() - innov2_);
  const double emf_expected = m.psi_f * std::max(std::abs(omega_e), p_.omega_e_min);
  r_ = residual_.norm() / emf_expected;
  share_of_emf_ = std::sqrt(innov2_) * m.L_q / (T_s_ * emf_expected);
  const bool beyond = by_emf() || (nis() > p_.nis_limit && share_of_emf_ > kShare);
  t_beyond_ = beyond ? t_beyond_ + T_s_ : 0;
  const bool within =
      r_ < 0.5 * p_.emf_limit && nis() < 0.5 * p_.nis_limit && std::abs(omega_e) > p_.omega_e_min;
  t_within_ = within ? t_within_ + T_s_ : 0;
  found_ = found_ || t_within_ > p_.t_lost;
  return t_beyond_ > (found_ ? p_.t_lost : p_.t_find);
}

}  // namespace twinrate

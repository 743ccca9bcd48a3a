// A gain and a covariance in the stationary frame, after the rotor has turned by an angle a.
//
//   K(theta_e + a) = T(a) K(theta_e) R(-a)
//   P(theta_e + a) = T(a) P(theta_e) T(-a)
//   T(a)           = diag(R(a), .., R(a), I)           one R(a) for each of `pairs`
//   R(a)           = [cos a, -sin a; sin a, cos a]
//
// `pairs`: number of leading (alpha, beta) pairs of states that turn (Filter::turning_pairs). The
// relations are exact for a model that is the same in every rotor position. An angle of 0 changes
// no bit.
#pragma once
#include <cmath>

#include "model/math.hpp"
#include "model/signals.hpp"

namespace twinrate {

class GainFrame {
 public:
  GainFrame(int pairs, double angle) : GainFrame(pairs, math::sincos(angle)) {}

  void turn_gain(Gain& gain) const {
    if (pairs_ == 0) return;
    turn_rows(gain.K);
    const auto k_alpha = gain.K.col(0).eval(), k_beta = gain.K.col(1).eval();
    gain.K.col(0) = c_ * k_alpha - s_ * k_beta;
    gain.K.col(1) = s_ * k_alpha + c_ * k_beta;
  }
  void turn_covariance(Gain& gain) const {
    turn_rows(gain.P);
    for (int pair = 0; pair < pairs_; ++pair) {
      const auto p_alpha = gain.P.col(2 * pair).eval(), p_beta = gain.P.col(2 * pair + 1).eval();
      gain.P.col(2 * pair) = c_ * p_alpha - s_ * p_beta;
      gain.P.col(2 * pair + 1) = s_ * p_alpha + c_ * p_beta;
    }
  }

 private:
  GainFrame(int pairs, const math::SinCos& at) : pairs_(pairs), c_(at.cos), s_(at.sin) {}
  template <class Matrix>
  void turn_rows(Matrix& m) const {
    for (int pair = 0; pair < pairs_; ++pair) {
      const auto alpha = m.row(2 * pair).eval(), beta = m.row(2 * pair + 1).eval();
      m.row(2 * pair) = c_ * alpha - s_ * beta;
      m.row(2 * pair + 1) = s_ * alpha + c_ * beta;
    }
  }
  int pairs_;
  double c_, s_;
};

}  // namespace twinrate

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
    turn_rows(gain.K, gain.n_y);
    for (int row = 0; row < gain.n_x; ++row) turn(gain.K(row, 0), gain.K(row, 1));
  }
  void turn_covariance(Gain& gain) const {
    turn_rows(gain.P, gain.n_x);
    for (int pair = 0; pair < pairs_; ++pair)
      for (int row = 0; row < gain.n_x; ++row)
        turn(gain.P(row, 2 * pair), gain.P(row, 2 * pair + 1));
  }

  // T(a) m, of the first `cols` columns.
  template <class Matrix>
  void turn_rows(Matrix& m, int cols) const {
    for (int pair = 0; pair < pairs_; ++pair)
      for (int col = 0; col < cols; ++col) turn(m(2 * pair, col), m(2 * pair + 1, col));
  }

 private:
  GainFrame(int pairs, const math::SinCos& at) : pairs_(pairs), c_(at.cos), s_(at.sin) {}
  void turn(double& alpha, double& beta) const {
    const double along_alpha = c_ * alpha - s_ * beta;
    beta = s_ * alpha + c_ * beta;
    alpha = along_alpha;
  }
  int pairs_;
  double c_, s_;
};

}  // namespace twinrate

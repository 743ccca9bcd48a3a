// Sine and cosine of an angle that several equations of a tick share. Of another angle they are
// computed, so an old pair costs time and never a wrong axis.
#pragma once
#include "model/math.hpp"

namespace twinrate {

struct RotorAxes {
  double theta_e = 0;
  math::SinCos at{0, 1};

  RotorAxes() = default;
  explicit RotorAxes(double angle) : theta_e(angle), at(math::sincos(angle)) {}
  math::SinCos of(double angle) const { return angle == theta_e ? at : math::sincos(angle); }
};

}  // namespace twinrate

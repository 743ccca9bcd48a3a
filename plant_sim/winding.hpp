// The winding of the simulated drive: one body heated by its copper loss.
//
//   tau dT/dt = T_ambient + rise (|i_dq|/i_rated)^2 - T
//
// Exact for a current that is constant over the step. Rated current: model/per_unit.hpp. The
// resistance of the machine does not follow the temperature; effect `resistance` changes it.
#pragma once
#include <cmath>

#include "model/fields.hpp"
#include "model/math.hpp"

namespace twinrate {

struct WindingParameters {
  double ambient = 25, rise = 80, tau = 60;
  void fields(FieldVisitor& f) {
    f.number("ambient_degC", ambient, -60, 200, "ambient temperature, and that of the first tick");
    f.number("rise_K", rise, 0, 1000, "final rise of the temperature at rated current");
    f.number("tau_s", tau, 1e-3, 1e5, "thermal time constant");
  }
};

class Winding {
 public:
  Winding(const WindingParameters& p, double i_rated, double T_s)
      : p_(p), i_rated_(i_rated), share_(1 - math::exp(-T_s / p.tau)), temperature_(p.ambient) {}

  // One period at the current amplitude `i`.
  void step(double i) {
    const double load = i / i_rated_;
    temperature_ += share_ * (p_.ambient + p_.rise * load * load - temperature_);
  }
  double temperature() const { return temperature_; }  // degC

 private:
  WindingParameters p_;
  double i_rated_, share_, temperature_;
};

}  // namespace twinrate

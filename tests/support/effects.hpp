// Effects as from a drive file, with generated values for unknown parameters.
#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"
#include "tests/support/field_setter.hpp"

namespace twinrate::test {

// A machine with slots and poles, as needed by every prepare().
inline DriveFacts drive_facts() {
  return {.machine = {.R_s = 1.05,
                      .L_d = 0.0127,
                      .L_q = 0.0127,
                      .psi_f = 0.2533,
                      .J = 8.8e-3,
                      .B = 0.003,
                      .n_p = 3,
                      .n_slots = 27},
          .v_dc = 235.4,
          .f_pwm = 1e4};
}

inline std::shared_ptr<Effect> effect_of(const char* kind, std::map<std::string, double> values,
                                         const DriveFacts& facts = drive_facts()) {
  const auto effect = make_effect(kind);
  FieldSetter set(std::move(values));
  effect->fields(set);
  EXPECT_EQ(effect->prepare(facts), "") << kind;
  return effect;
}

// Sets every number to a different value of its range.
class PlausibleValues final : public FieldSetter {
 public:
  void number(const char* key, double& value, double lo, double hi, const char*,
              Presence) override {
    if (std::string(key) == "J_load_kgm2") {
      value = 2e-3;  // less than the drive has
      return;
    }
    if (std::string(key) == "start_s") return;  // a moment, not a size
    // Well inside the range: its end may not go with the drive (a dead time of a whole period).
    value = std::clamp(std::min(0.31 + 0.17 * count_++, 0.3 * hi), lo, hi);
  }
  void integer(const char*, int& value, int lo, int hi, const char*, Presence) override {
    value = std::clamp(5 + 2 * count_++, lo, hi);
  }

 private:
  int count_ = 0;
};

// Sets every number to zero that may be zero.
class Silence final : public FieldSetter {
 public:
  void number(const char*, double& value, double lo, double hi, const char*, Presence) override {
    if (lo <= 0 && hi >= 0) value = 0;
  }
};

// Every field of a contribution, in one vector: T_load, u_d, u_q, v_dc, i_a, i_b, i_c, theta_m, J,
// psi_d, psi_q, omega_m.
using Flat = Eigen::Matrix<double, 12, 1>;
inline Flat flat(const Contribution& c) {
  Flat all;
  all << c.T_load, c.u_dq_drop, c.v_dc, c.i_abc, c.theta_m, c.J, c.psi_dq, c.omega_m;
  return all;
}

// The bits of acts_on() that a contribution touches.
inline int touched(const Contribution& c) {
  return (c.T_load != 0 || c.J != 0 ? kOnTorque : 0) | (c.u_dq_drop.isZero(0) ? 0 : kOnVoltage) |
         (c.v_dc != 0 ? kOnBus : 0) | (c.i_abc.isZero(0) ? 0 : kOnCurrents) |
         (c.theta_m != 0 ? kOnAngle : 0) | (c.psi_dq.isZero(0) ? 0 : kOnFlux) |
         (c.omega_m != 0 ? kOnSpeed : 0);
}

}  // namespace twinrate::test

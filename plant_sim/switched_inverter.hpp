// Two-level inverter switched event by event: one symmetric carrier period after the other.
//
// A leg with duty d is requested high from T_pwm (1 - d)/2 to T_pwm (1 + d)/2 of its period. A
// switch turns off at once and turns on after the dead time t_d. In between both switches are off
// and the diodes carry the current:
//
//   low    v = 0
//   high   v = v_dc
//   dead   v = v_dc/2 (1 - sat(i/i_zero))              lower diode for a positive current, upper
//                                                      diode for a negative one
//   i_zero = v_dc t_d/(2 L)
//
// All edges are known as soon as the duties are, 4 a leg: 13 segments of constant state a period (7
// without dead time), one more for each leg whose last fall extends beyond the end of its period,
// and no search is needed. A leg in dead time whose current reaches zero stays there: a blocking
// leg has the voltage that keeps its current at zero. i_zero = v_dc t_d/(2 L) makes this a decay
// within about t_d, which a real leg's output capacitance also takes. Pulses shorter than the dead
// time vanish; a leg at duty 0 or 1 does not switch, whatever the period before.
#pragma once
#include <array>
#include <span>

#include "model/frames.hpp"

namespace twinrate {

enum class Leg : int { kLow = 0, kHigh = 1, kDead = 2 };

struct LegStates {
  std::array<Leg, 3> legs{};
  double i_zero = 1;  // A

  Vec2 u_alphabeta(const Vec3& i_abc, double v_dc) const;
};

struct Segment {
  double t_start = 0, T = 0;  // s, from the start of the period
  LegStates states;
};

class SwitchedInverter {
 public:
  SwitchedInverter(double T_pwm, double t_d, double i_zero)
      : T_pwm_(T_pwm), t_d_(t_d), i_zero_(i_zero) {}

  // The next period. Valid until the next call.
  std::span<const Segment> next_period(const Vec3& duty_abc);

 private:
  // One leg over one period; times from its start, those at or beyond its end never come.
  struct LegPlan {
    double low_from = 0;   // lower switch conducts from here ..
    double rise = 0;       // .. to here
    double high_from = 0;  // upper switch conducts from here ..
    double fall = 0;       // .. to here
    double low_again = 0;  // lower switch conducts from here on
    bool high_at_end = false;
    Leg state(double t) const;
  };
  LegPlan plan(const LegPlan& before, double duty) const;

  double T_pwm_, t_d_, i_zero_;
  std::array<LegPlan, 3> plans_{};
  std::array<Segment, 16> segments_{};
};

}  // namespace twinrate

// Effects on the samples that do not merely add to a reading (SamplingFacts of
// model/effects/effect.hpp): late signals, coarse or clipped currents, lost or repeated rows.
//
//   voltage         an earlier request acts in an interval (duty cycles, averaged)
//   current, angle  a delay: the sensor sees the plant's own state at t_k - delay. LateState names
//                   the moment in each interval at which the plant stores its state. A filter:
//                   exact for a signal that is linear between ticks
//   speed           the reported one, linear between ticks
//   missing         nothing is measured except the voltage, which the drive knows; fields repeat
//                   the row before
//   stale           everything measured, with the values of the row before
//
// The affected row is a function of run.seed and k alone.
#pragma once
#include "model/effects/effect.hpp"
#include "model/effects/lag.hpp"
#include "model/signals.hpp"
#include "plant_sim/drive_model.hpp"

namespace twinrate {

// The plant's state as a delayed sensor sees it.
class LateState {
 public:
  LateState(double delay, double T_s, const PlantState& start);

  // In every interval, s from its start, in (0, T_s]: the state there is the argument of caught().
  double moment() const { return moment_; }
  PlantState& caught() { return caught_; }
  // At the end of an interval: the state that the sensor sees then.
  const PlantState& seen() {
    seen_ = line_.pass(caught_);
    return seen_;
  }

 private:
  double moment_;
  DelayLine<PlantState> line_;
  PlantState caught_, seen_;
};

class SampleErrors {
 public:
  SampleErrors(const SamplingFacts& facts, double T_s, std::uint64_t seed);

  // Once an interval each.
  Vec3 acting_duty(const Vec3& asked) { return duty_filter_.pass(duty_delay_.pass(asked)); }
  Vec3 filtered_currents(const Vec3& i_abc) { return current_filter_.pass(i_abc); }
  double filtered_angle(double theta_m) { return angle_filter_.pass(theta_m); }
  double late_speed(double omega_m) { return speed_filter_.pass(speed_delay_.pass(omega_m)); }
  bool angle_is_late() const;

  // `current_sensors`: with two, the third phase is computed from the others.
  Vec3 converted(const Vec3& i_abc, int current_sensors) const;
  // MEASUREMENT(k) after `before`, MEASUREMENT(k-1).
  void spoil_row(Measurement& m, const Measurement& before) const;

 private:
  SamplingFacts facts_;
  std::uint64_t seed_;
  DelayLine<Vec3> duty_delay_;
  HeldLowPass<Vec3> duty_filter_;
  LowPass<Vec3> current_filter_;
  LowPass<double> angle_filter_;
  DelayLine<double> speed_delay_;
  LowPass<double> speed_filter_;
};

}  // namespace twinrate

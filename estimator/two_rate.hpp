// The two halves of a two-rate filter, for every process and the one-process simulation.
//
//   FastLoop        MEASUREMENT(k), gains so far -> ESTIMATE(k)      at f_s
//   BackgroundLoop  ESTIMATE(s), s = 0, n, 2n .. -> GAIN(s)          at f_b = f_s/n
//
// The gain policies; core/rates.hpp defines when a gain is used:
//
//   paper        K of the snapshot s, unchanged
//   immediate    the same, used at the next tick
//   extrapolate  K linearised at the angle in the middle of its use, 1.5 (n - 1) ticks ahead
//   rotate       K_use = T(a) K R(-a),  a = theta_e of tick k-1 less that of the snapshot
//   rotor_frame  the same, and P is turned by (n - 1) omega_e T_s before each background step
//   scheduled    no background: K from a table over speed, turned to theta_e of tick k-1
//   propagated   P stepped through every tick, K for several speeds: estimator/propagated_gain.hpp
//
// T(a), R(a): estimator/gain_frame.hpp. With n = 1 the first five are the ordinary extended Kalman
// filter, bit for bit.
#pragma once
#include <limits>
#include <memory>

#include "core/rate_history.hpp"
#include "estimator/agreement.hpp"
#include "estimator/covariance_ceiling.hpp"
#include "estimator/filter.hpp"
#include "estimator/gain_schedule.hpp"
#include "estimator/gain_slots.hpp"

namespace twinrate {

// Operation of the fast loop without the background.
struct ScheduleUse {
  std::shared_ptr<const GainSchedule> schedule;  // required by policy `scheduled`
  // A gain whose snapshot is older than this is replaced by the table, if there is one.
  std::int64_t max_age_ticks = std::numeric_limits<std::int64_t>::max();
};

// Turns `gain` to its form in tick k; `last` is the estimate of tick k-1, whose angle and speed the
// ordinary filter uses to compute its gain. A gain from before the first snapshot is not changed.
void turn_for_use(GainPolicy policy, const Filter& filter, const Estimate& last, Gain& gain);

class FastLoop {
 public:
  // With `agreement` a gain is due every tick until the filter agrees with itself, then every
  // rate.n ticks; the status bit kGainEveryTick marks the first phase.
  FastLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, BackgroundRate rate,
           ScheduleUse schedule_use = {}, std::optional<Agreement> agreement = {});

  // Clears all state: the next sample starts a session.
  void reset();
  void take_gain(const Gain& gain) { gains_.push(gain); }
  // The same filter with other known effects, from the next tick on; estimates and gains are kept.
  void exchange(std::shared_ptr<const Filter> filter);
  // Rate and policy change at these ticks; changes up to the last tick must be the same as before.
  // A schedule is needed if one of the policies is `scheduled`.
  void follow(std::vector<RateChange> changes, std::shared_ptr<const GainSchedule> schedule = {});
  // True if the gain that tick k plans to use has arrived (or none is planned yet).
  bool gain_ready(std::int64_t k) const;
  // Runs one tick. Samples missing since the last one are predicted over (at most kMaxGap, else the
  // filter starts again from this sample). A late gain is replaced by the newest older one, a gain
  // that is too old by the table; status reports both. A sample without any sensor's reading
  // (signals) is predicted over in the same way, under its own voltage. The returned estimate is
  // valid until the next tick.
  const Estimate& tick(const Measurement& m);

  std::int64_t last_k() const { return last_.k; }
  // As after the last tick.
  BackgroundRate rate() const { return rate_; }
  GainPolicy policy() const { return policy_; }
  // The rate that tick k had, up to one change back.
  BackgroundRate rate_at(std::int64_t k) const { return k < changed_k_ ? rate_before_ : rate_; }
  static constexpr std::int64_t kMaxGap = 50;

 private:
  const Estimate& tick_as_seen(const Measurement& m);
  // The gain of tick k; adds to `status`.
  const Gain& choose_gain(std::int64_t k, int& status);
  bool too_old(const Gain& gain, std::int64_t k) const;
  // Starts a session with `m`, or predicts over the samples missing before it; adds to `status`.
  // True for the first sample of a session.
  bool begin_tick(const Measurement& m, int& status);
  // Prediction to t_k and correction; a sample without a sensor's reading is predicted over.
  Correction correct(const Measurement& m, const Gain& gain, int& status);
  // Adds kGainEveryTick; after an agreement the next multiple of n begins the slow rate.
  void watch_agreement(Estimate& e, const Measurement& m);
  // The changes up to tick k, after its gain was chosen.
  void change_rate(std::int64_t k);

  std::shared_ptr<const Filter> filter_;
  GainPolicy policy_, first_policy_;
  BackgroundRate rate_, first_rate_, rate_before_;
  std::vector<RateChange> changes_;
  std::size_t next_change_ = 0;
  std::int64_t changed_k_ = -1;  // of the last change that was made
  ScheduleUse schedule_use_;
  std::optional<Agreement> agreement_;
  FastState state_;
  GainSlots gains_;
  Gain made_;                         // turned, or from the table
  Measurement last_, last_measured_;  // as the filter uses it; as received, if different
  Estimate last_estimate_;
  std::int64_t k0_ = 0;  // first sample of the session: snapshots count from here
};

class BackgroundLoop {
 public:
  // `span_omega_m`: policy propagated, largest change of speed while a gain is in use.
  BackgroundLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, BackgroundRate rate,
                 double span_omega_m = 0);

  void reset();
  // True if the snapshot has the states of the filter, or of its form without voltages.
  bool fits(const Estimate& snapshot) const {
    return snapshot.n_x >= (snapshot.status & kNoVoltage ? n_x_without_voltage_ : n_x_);
  }
  // Computes K from the snapshot and propagates P with it.
  const Gain& step(const Estimate& snapshot);
  // The snapshot after the last one.
  std::int64_t next_k() const { return gain_.k < 0 ? 0 : gain_.k + n_last_; }
  // As FastLoop::exchange, from the next snapshot on.
  void exchange(std::shared_ptr<const Filter> filter) { filter_ = std::move(filter); }
  // As FastLoop::follow.
  void follow(std::vector<RateChange> changes);
  // From the next snapshot on; without this call there is no ceiling.
  void limit(const CovarianceCeiling& ceiling) { ceiling_ = ceiling; }
  const CovarianceCeiling& ceiling() const { return ceiling_; }
  const Gain& last() const { return gain_; }

 private:
  // Makes the changes up to this snapshot; true if there were some.
  bool change_rate(std::int64_t k);
  // gain_ from the snapshot, by the policy.
  void update(const Estimate& snapshot, int n_before, int n);

  std::shared_ptr<const Filter> filter_;
  CovarianceCeiling ceiling_;
  GainPolicy policy_, first_policy_;
  BackgroundRate rate_, first_rate_;
  std::vector<RateChange> changes_;
  std::size_t next_change_ = 0;
  double span_omega_m_;
  Gain gain_;
  int n_x_ = 0, n_x_without_voltage_ = 0;
  int n_last_ = 1;             // ticks from the last snapshot to the next
  double omega_m_before_ = 0;  // of the last snapshot
};

}  // namespace twinrate

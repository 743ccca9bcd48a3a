#include "estimator/two_rate.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

#include "estimator/gain_frame.hpp"
#include "estimator/propagated_gain.hpp"

namespace twinrate {

FastLoop::FastLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, BackgroundRate rate,
                   ScheduleUse schedule_use, std::optional<Agreement> agreement)
    : filter_(std::move(filter)),
      policy_(policy),
      first_policy_(policy),
      rate_(rate),
      first_rate_(rate),
      rate_before_(rate),
      schedule_use_(std::move(schedule_use)),
      agreement_(std::move(agreement)) {
  assert(has_background(policy_) || schedule_use_.schedule);
  reset();
}

void FastLoop::reset() {
  gains_.reset(filter_->initial_gain());
  last_ = last_measured_ = Measurement{};
  last_estimate_ = Estimate{};
  policy_ = first_policy_;
  rate_ = rate_before_ = first_rate_;
  next_change_ = 0;
  changed_k_ = -1;
  if (!agreement_) return;
  agreement_->reset();
  rate_.from = BackgroundRate::kNotYet;
}

void FastLoop::follow(std::vector<RateChange> changes,
                      std::shared_ptr<const GainSchedule> schedule) {
  changes_ = std::move(changes);
  next_change_ = 0;
  while (next_change_ < changes_.size() && changes_[next_change_].k <= changed_k_) ++next_change_;
  if (schedule) schedule_use_.schedule = std::move(schedule);
}

void FastLoop::change_rate(std::int64_t k) {
  for (; next_change_ < changes_.size() && changes_[next_change_].k <= k; ++next_change_) {
    const RateChange& change = changes_[next_change_];
    const bool waits = agreement_ && rate_.from == BackgroundRate::kNotYet;
    rate_before_ = rate_;
    rate_ = change.rate();
    if (waits) rate_.from = BackgroundRate::kNotYet;
    policy_ = change.policy;
    changed_k_ = change.k;
  }
}

void FastLoop::exchange(std::shared_ptr<const Filter> filter) {
  if (filter_->sees_all()) last_measured_ = last_;
  filter_ = std::move(filter);
}

bool FastLoop::gain_ready(std::int64_t k) const {
  const std::int64_t snapshot = snapshot_for_tick(policy_, k, rate_);
  return last_.k < 0 || snapshot < k0_ || gains_.has(snapshot);
}

bool FastLoop::too_old(const Gain& gain, std::int64_t k) const {
  return schedule_use_.schedule && k - std::max(gain.k, k0_) > schedule_use_.max_age_ticks;
}

void turn_for_use(GainPolicy policy, const Filter& filter, const Estimate& last, Gain& gain) {
  if (gain.k < 0) return;
  if (turns_gain(policy))
    GainFrame(filter.turning_pairs(), last.theta_e - gain.theta_e).turn_gain(gain);
  if (policy == GainPolicy::kPropagated)
    use_at_speed(filter.turning_pairs(), last.omega_m, last.theta_e, gain);
}

const Gain& FastLoop::choose_gain(std::int64_t k, int& status) {
  const std::int64_t snapshot = snapshot_for_tick(policy_, k, rate_);
  const Gain& gain = gains_.newest_up_to(snapshot);
  if (snapshot >= k0_ && gain.k != snapshot) status |= kLateGain;
  if (!has_background(policy_) || too_old(gain, k)) {
    status |= kScheduledGain;
    made_ = schedule_use_.schedule->at(last_estimate_.omega_m, last_estimate_.theta_e);
    return made_;
  }
  if (gain.k < 0) status |= kBeforeFirstGain;
  if (gain.k < 0 || !is_made_for_use(policy_)) return gain;
  made_ = gain;
  turn_for_use(policy_, *filter_, last_estimate_, made_);
  return made_;
}

// A lost row still holds the voltage, which the drive knows without a sensor.
static bool is_lost_row(const Measurement& m) {
  return (m.signals & ~kBusVoltage) == kVoltage;
}

bool FastLoop::begin_tick(const Measurement& m, int& status) {
  const std::int64_t missing = last_.k < 0 ? 0 : m.k - last_.k - 1;
  if (missing > 0) status |= kGapBridged;
  if (missing > kMaxGap) reset();
  if (last_.k >= 0) {
    for (std::int64_t i = 0; i < missing; ++i) filter_->predict_over_gap(state_, last_);
    if (missing > 0) last_estimate_ = filter_->output(state_, last_);
    return false;
  }
  k0_ = m.k;
  state_ = filter_->start(m);
  if (!state_.x_hat.allFinite()) {  // nothing measured to start from: zero, as at standstill
    state_ = filter_->start({.signals = m.signals});
    status |= kNotFinite;
  }
  return true;
}

Correction FastLoop::correct(const Measurement& m, const Gain& gain, int& status) {
  if (!is_lost_row(m)) return filter_->fast_step(state_, m, gain);
  filter_->predict_over_gap(state_, m);
  last_.theta_m = state_.theta_m_prev;
  status |= kGapBridged;
  return {};
}

const Estimate& FastLoop::tick(const Measurement& measured) {
  if (filter_->sees_all()) return tick_as_seen(measured);
  const Measurement m = filter_->seen(measured, last_estimate_, last_measured_);
  tick_as_seen(m);
  last_measured_ = measured;
  return last_estimate_;
}

[[gnu::flatten]] const Estimate& FastLoop::tick_as_seen(const Measurement& m) {
  int status = 0;
  const bool first = begin_tick(m, status);
  const Gain& gain = choose_gain(m.k, status);
  change_rate(m.k);
  last_ = m;
  const Correction correction = first ? Correction{} : correct(m, gain, status);
  if (m.mode == Mode::kAlign) {
    filter_->align(state_, m.theta_forced);
    status |= kAngleForced;
  }
  Estimate& e = last_estimate_;
  filter_->output_of_tick(state_, last_, e);
  e.x_hat = state_.x_hat;
  e.k = m.k;
  e.t_ns = m.t_ns;
  e.gain_seq = gain.k;
  e.innov = correction.innov;
  e.status |= status | correction.status;
  if (agreement_) watch_agreement(e, last_);
  return e;
}

void FastLoop::watch_agreement(Estimate& e, const Measurement& m) {
  if (rate_.from == BackgroundRate::kNotYet && agreement_->step(e, m))
    rate_.from = next_multiple(std::max(e.k, changed_k_ + 1), rate_.n);
  if (e.k < rate_.from) e.status |= kGainEveryTick;
}

BackgroundLoop::BackgroundLoop(std::shared_ptr<const Filter> filter, GainPolicy policy,
                               BackgroundRate rate, double span_omega_m)
    : filter_(std::move(filter)),
      policy_(policy),
      first_policy_(policy),
      rate_(rate),
      first_rate_(rate),
      span_omega_m_(span_omega_m),
      n_x_(filter_->initial_gain().n_x),
      n_x_without_voltage_(filter_->initial_gain_without_voltage().n_x) {
  reset();
}

void BackgroundLoop::reset() {
  gain_ = filter_->initial_gain();
  n_last_ = 1;
  policy_ = first_policy_;
  rate_ = first_rate_;
  next_change_ = 0;
}

void BackgroundLoop::follow(std::vector<RateChange> changes) {
  changes_ = std::move(changes);
  next_change_ = 0;
  while (next_change_ < changes_.size() && changes_[next_change_].k <= gain_.k) ++next_change_;
}

bool BackgroundLoop::change_rate(std::int64_t k) {
  const std::size_t before = next_change_;
  for (; next_change_ < changes_.size() && changes_[next_change_].k <= k; ++next_change_) {
    rate_ = changes_[next_change_].rate();
    policy_ = changes_[next_change_].policy;
  }
  return next_change_ != before;
}

const Gain& BackgroundLoop::step(const Estimate& snapshot) {
  if (snapshot.status & kAngleForced) gain_.P = filter_->initial_gain().P;
  if (change_rate(snapshot.k) && gain_.k >= 0) {
    n_last_ = static_cast<int>(std::clamp<std::int64_t>(snapshot.k - gain_.k, 1, 1'000'000));
    gain_.n_speeds = 0;
  }
  const int n = snapshot.status & kGainEveryTick ? 1 : rate_.n_at(snapshot.k);
  const int n_before = std::exchange(n_last_, n);
  update(snapshot, n_before, n);
  ceiling_.apply(gain_);
  gain_.first_use = first_use_of(policy_, snapshot.k, n);
  return gain_;
}

void BackgroundLoop::update(const Estimate& snapshot, int n_before, int n) {
  const double omega_m_before = std::exchange(omega_m_before_, snapshot.omega_m);
  if (policy_ == GainPolicy::kPropagated) {
    gain_ = propagated_background(*filter_, gain_, omega_m_before, snapshot, n, span_omega_m_);
    return;
  }
  if (policy_ == GainPolicy::kRotorFrame && gain_.k >= 0) {
    const double turned = filter_->ahead(snapshot, n_before - 1).theta_e - snapshot.theta_e;
    GainFrame(filter_->turning_pairs(), turned).turn_covariance(gain_);
  }
  if (policy_ == GainPolicy::kExtrapolate) {
    const Estimate at = filter_->ahead(snapshot, 1.5 * (n - 1));
    filter_->update_gain(gain_, at);
    gain_.theta_e = at.theta_e;
  } else {
    filter_->update_gain(gain_, snapshot);
    gain_.theta_e = snapshot.theta_e;
  }
}

}  // namespace twinrate

#include "estimator/two_rate.hpp"

namespace twinrate {

FastLoop::FastLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, int n)
    : filter_(std::move(filter)), policy_(policy), n_(n) {
  reset();
}

void FastLoop::reset() {
  gains_.reset(filter_->initial_gain());
  last_ = Measurement{};
}

bool FastLoop::gain_ready(std::int64_t k) const {
  const std::int64_t snapshot = snapshot_for_tick(policy_, k, n_);
  return last_.k < 0 || snapshot < k0_ || gains_.has(snapshot);
}

Estimate FastLoop::tick(const Measurement& m) {
  const std::int64_t missing = last_.k < 0 ? 0 : m.k - last_.k - 1;
  int status = missing > 0 ? kGapBridged : 0;
  if (missing > kMaxGap) reset();
  const bool first = last_.k < 0;
  if (first) {
    k0_ = m.k;
    state_ = filter_->start(m);
    if (!state_.x_hat.allFinite()) {  // nothing measured to start from: zero, as at standstill
      state_ = filter_->start({.signals = m.signals});
      status |= kNotFinite;
    }
  } else {
    for (std::int64_t i = 0; i < missing; ++i) filter_->predict_over_gap(state_, last_);
  }

  const std::int64_t snapshot = snapshot_for_tick(policy_, m.k, n_);
  const Gain& gain = gains_.newest_up_to(snapshot);
  if (gain.k < 0) status |= kBeforeFirstGain;
  if (snapshot >= k0_ && gain.k != snapshot) status |= kLateGain;

  Correction correction;
  if (!first) correction = filter_->fast_step(state_, m, gain);
  if (m.mode == Mode::kAlign) {
    filter_->align(state_, m.theta_forced);
    status |= kAngleForced;
  }
  last_ = m;

  Estimate e = filter_->output(state_, m);
  e.k = m.k;
  e.t_ns = m.t_ns;
  e.gain_seq = gain.k;
  e.x_hat = state_.x_hat;
  e.innov = correction.innov;
  e.status |= status | correction.status;
  return e;
}

BackgroundLoop::BackgroundLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, int n)
    : filter_(std::move(filter)), policy_(policy), n_(n) {
  reset();
}

void BackgroundLoop::reset() {
  gain_ = filter_->initial_gain();
}

const Gain& BackgroundLoop::step(const Estimate& snapshot) {
  if (snapshot.status & kAngleForced) gain_.P = filter_->initial_gain().P;
  gain_ = filter_->background_step(gain_, snapshot);
  gain_.first_use = first_use_of(policy_, snapshot.k, n_);
  return gain_;
}

}  // namespace twinrate

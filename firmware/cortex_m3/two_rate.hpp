// The two halves of the filter around ekf.hpp, for the control interrupt and for the background.
//
//   fast(k, sample)    at f_s: prediction, correction with the gain planned for tick k; at a snapshot
//                      it hands the state to the background
//   background()       after fast(), below its priority: P^-, K, P from the snapshot
//
// The gain of snapshot s is used from tick s + n on and held until the next one (n = 1: the ordinary
// filter); before tick `from` n is 1. Policies of estimator/two_rate.hpp: paper, rotate, scheduled.
// If the background has not finished when its gain or the next snapshot is due, that is counted in
// `late`; the old gain is held, and the snapshot is skipped.
#pragma once
#include "firmware/cortex_m3/schedule.hpp"

namespace twinrate::m3 {

enum class Policy : int32_t { kPaper = 0, kRotate = 1, kScheduled = 2 };

// Settings that the host sends before the first tick.
struct Settings {
  StepConstants step;
  CovarianceConstants covariance, covariance16;  // of the two variants
  int32_t omega_start;                           // raw
  uint32_t theta_start;
  Policy policy;
  int32_t n;
  int32_t from;  // a multiple of n
  ScheduleTable schedule;
};

// Raw numbers, Q25.
struct Sample {
  int32_t i_alpha, i_beta, u_alpha, u_beta;
};

template <class N, class Q>
class TwoRate {
 public:
  using L = typename N::Long;
  using LW = typename L::Word;

  void start(const Settings& settings) {
    settings_ = &settings;
    const CovarianceConstants& c = constants();
    const auto cell = [](int32_t raw) { return N::cell(typename N::Word(raw)); };
    const auto zero = cell(0);
    P_ = {cell(c.P0[0]), zero, zero,          zero, cell(c.P0[1]),
          zero,          zero, cell(c.P0[2]), zero, cell(c.P0[3])};
    for (Slot& slot : slots_)
      slot = {{zero, zero, zero, zero, zero, zero, zero, zero}, 0, -1, false};
    clamps_background_ = Clamps{};
    clamps_fast_ = Clamps{};
    x_ = {};
    active_ = 0;
    next_use_ = -1;
    due_ = pending_ = false;
    late_ = 0;
  }

  void fast(int32_t k, const Sample& sample) {
    const Pair<L> y{LW(sample.i_alpha), LW(sample.i_beta)};
    if (k == 0) {
      x_ = {y.alpha, y.beta, LW(settings_->omega_start), settings_->theta_start};
    } else {
      take_gain_planned_for(k);
      step({LW(sample.u_alpha), LW(sample.u_beta)}, y);
    }
    at_ = unit_vector<L>(x_.theta);
    if (settings_->policy != Policy::kScheduled && is_snapshot(k)) hand_over(k);
  }

  bool background_due() const { return due_; }
  // A gain that the background has finished and that no tick uses yet, with its covariance.
  struct Finished {
    const Gain<N>& K;
    const Covariance<N>& P;
    uint32_t theta;
    int32_t k;
  };
  bool has_finished() const { return !due_ && slots_[1 - active_].ready; }
  Finished finished() const {
    const Slot& slot = slots_[1 - active_];
    return {slot.K, P_, slot.theta, slot.k};
  }
  // The barriers stop the compiler from moving results across `ready` and `due_`, which the
  // interrupt reads.
  void background() {
    asm volatile("" ::: "memory");
    Slot& slot = slots_[1 - active_];
    const CovarianceConstants& c = constants();
    const Jacobian<N> F = jacobian<N, Q>(c, snapshot_.omega, snapshot_.at);
    const Covariance<N> P_prior = propagate<N, Q>(c, F, P_);
    slot.K = gain<N, Q>(c, P_prior);
    P_ = posterior<N, Q>(c, P_prior, slot.K, clamps_background_);
    slot.theta = snapshot_.theta;
    slot.k = snapshot_.k;
    asm volatile("" ::: "memory");
    slot.ready = true;
    asm volatile("" ::: "memory");
    due_ = false;
  }

  const State<L>& state() const { return x_; }
  const Pair<L>& last_innovation() const { return innov_; }
  const Covariance<N>& covariance() const { return P_; }
  const Gain<N>& gain_in_use() const { return slots_[active_].K; }
  int32_t gain_snapshot() const { return slots_[active_].k; }
  uint32_t late() const { return late_; }
  Clamps clamps() const {
    Clamps sum = clamps_background_;
    sum.omega += clamps_fast_.omega;
    return sum;
  }

 private:
  struct Slot {
    Gain<N> K;
    uint32_t theta;  // of the snapshot
    int32_t k;
    bool ready;
  };
  struct Snapshot {
    LW omega;
    UnitVector<L> at;
    uint32_t theta;
    int32_t k;
  };

  const CovarianceConstants& constants() const {
    return sizeof(typename N::Cell) == 2 ? settings_->covariance16 : settings_->covariance;
  }
  int32_t n_at(int32_t k) const { return k < settings_->from ? 1 : settings_->n; }
  bool is_snapshot(int32_t k) const { return k % n_at(k) == 0; }

  void take_gain_planned_for(int32_t k) {
    if (!pending_ || k != next_use_) return;
    pending_ = false;
    if (!slots_[1 - active_].ready) {
      ++late_;
      return;
    }
    active_ = 1 - active_;
    slots_[1 - active_].ready = false;
  }

  void hand_over(int32_t k) {
    if (due_) {
      ++late_;
      return;
    }
    snapshot_ = {x_.omega, at_, x_.theta, k};
    next_use_ = k + n_at(k);
    pending_ = true;
    slots_[1 - active_].ready = false;
    due_ = true;
  }

  TWINRATE_M3_INLINE void step(const Pair<L>& u, const Pair<L>& y) {
    const StepConstants& c = settings_->step;
    const State<L> prior = predict<L>(c, x_, at_, u);
    innov_ = innovation<L>(prior, y);
    if (settings_->policy == Policy::kPaper) {
      x_ = correct<N, Q>(c, prior, slots_[active_].K, innov_, clamps_fast_);
    } else if (settings_->policy == Policy::kRotate) {
      const Slot& slot = slots_[active_];
      const uint32_t turned = slot.k < 0 ? 0 : x_.theta - slot.theta;
      x_ = correct_turned<N, Q>(c, prior, slot.K, unit_vector<L>(turned), innov_, clamps_fast_);
    } else {
      x_ = correct_scheduled<L>(c, prior, settings_->schedule, x_.omega, at_, innov_, clamps_fast_);
    }
  }

  const Settings* settings_ = nullptr;
  State<L> x_;
  UnitVector<L> at_{};  // of x_.theta
  Pair<L> innov_{};
  Covariance<N> P_{};
  Slot slots_[2] = {};
  int active_ = 0;
  Snapshot snapshot_{};
  int32_t next_use_ = -1;
  bool pending_ = false;
  volatile bool due_ = false;
  uint32_t late_ = 0;
  Clamps clamps_background_, clamps_fast_;
};

}  // namespace twinrate::m3

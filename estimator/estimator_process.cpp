// The fast correction loop as a process.
//
// Lock-step: the tick waits for the gain that it plans to use, so the result does not depend on
// scheduling. Meanwhile it repeats the snapshot of that gain, and samples from a log player queue
// up. Realtime: nobody waits, the older gain is held and counted; a gain older than
// gain.max_age_ticks is replaced by the table over speed.
#include "estimator/estimator_process.hpp"

#include <fmt/format.h>

#include <deque>
#include <utility>

#include "core/process.hpp"
#include "core/recent.hpp"
#include "core/signals_io.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {
namespace {

class EstimatorProcess {
 public:
  EstimatorProcess(Process& p, const MakeFilter& make)
      : p_(p),
        fast_(make_fast_loop(p.config(), !p.lockstep(), make)),
        first_gain_(make(p.config())->initial_gain()),
        first_without_voltage_(make(p.config())->initial_gain_without_voltage()) {
    p.bus().subscribe<gain_t>([this](const gain_t& w) { take_gain(from_wire(w)); });
    p.bus().subscribe<measurement_t>([this](const measurement_t& w) { take(from_wire(w)); });
    p.bus().subscribe<ack_t>([this](const ack_t& ack) { repeat_snapshots(ack); });
    p.bus().on_new_session([this] { reset(-1); });
    p.waiting_for([this] { return missing(); });
    p.on_new_model([this, make](Config& extended) {
      return [this, filter = std::shared_ptr<const Filter>(make(extended))](std::int64_t k) {
        coming_.emplace_back(k, filter);
      };
    });
    p.on_steering(
        {.check = [this](const SteeredDrive& wanted, std::int64_t k) { check(wanted, k); },
         .follow =
             [this](const SteeredDrive& now) { fast_.follow(now.rates().changes(), schedule_); }});
    p.on_reset([this](std::int64_t k) { return reset_at(k); });
    const auto planned = planned_resets(p.config());
    resets_.assign(planned.begin(), planned.end());
  }
  void run() {
    p_.ready();
    p_.run([this] { repeat_what_is_waited_for(); });
  }

 private:
  static constexpr std::size_t kQueueLimit =
      4096;  // samples; beyond it the gain process is assumed gone

  Waiting missing() const {
    if (waiting_.empty())
      return {fmt::format("MEASUREMENT({})", last_.k + 1), Patience::kForMeasurement, Role::kPlant};
    return {fmt::format("GAIN for tick {}", waiting_.front().k), Patience::kForGain, Role::kGain};
  }
  // Checks that the filter supports policy and compensation; builds the table that they need.
  void check(const SteeredDrive& wanted, std::int64_t k) {
    const auto filter = make_filter(p_.config());
    for (const GainPolicy policy : wanted.policies_from(k)) {
      require_policy(p_.config(), *filter, policy);
      if (!has_background(policy) && !schedule_)
        schedule_ = GainSchedule::build(*filter, p_.drive().omega_m_limit());
    }
    for (const Compensation compensation : wanted.compensations_from(k))
      if (const std::string needs = compensation_needs(compensation, p_.drive(), *filter);
          !needs.empty())
        throw BadInput(fmt::format("compensation={}: needs {}",
                                   kCompensationNames[static_cast<int>(compensation)], needs));
  }
  void reset(std::int64_t k) {
    fast_.reset();
    last_ = Estimate{};
    waiting_.clear();
    snapshots_ = {};
    restarted_k_ = -1;
    p_.event(Reason::kEstimatorReset, k, "the sequence started again: the filter restarted");
  }
  // The drive leaves SAFE: its rotor angle is unknown.
  std::string reset_at(std::int64_t k) {
    if (!drive_is_off_) return "the drive is not off";
    restart_k_ = k;
    return "";
  }
  void restart(std::int64_t k) {
    restart_k_ = INT64_MAX;
    restarted_k_ = k;
    while (!resets_.empty() && k >= resets_.front()) resets_.pop_front();
    fast_.reset();
    if (p_.drive().locks_first()) p_.gains_every_nth(fast_.rate());
    p_.event(Reason::kReset, k, "the drive leaves SAFE: the filter restarted");
  }
  void take(const Measurement& m) {
    if (m.k == last_.k || (!waiting_.empty() && m.k == waiting_.back().k)) {
      ++p_.status().duplicates;
      if (m.k == last_.k) p_.bus().publish(to_wire(last_, p_.bus().session()));
      return;
    }
    if (m.k < (waiting_.empty() ? last_.k : waiting_.back().k)) {
      if (!p_.options().follow) return;
      reset(m.k);
    }
    if (p_.in_turn() && m.k > (waiting_.empty() ? last_.k : waiting_.back().k) + 1)
      return p_.bus().refuse();
    waiting_.push_back(m);
    tick_while_ready();
  }
  // A gain answers a snapshot of this process. An implausible one is requested again; the second
  // time the older gain is held.
  void take_gain(const Gain& gain) {
    const bool later = p_.bus().bound() && !p_.options().follow && gain.k > last_.k;
    const bool answers = gain.k >= 0 && is_snapshot(gain.k, fast_.rate_at(gain.k));
    if (later || !answers) return p_.bus().refuse();
    if (gain.k < restarted_k_) return;  // of the filter before the reset: it may come at any time
    if (fits(gain, last_.status & kNoVoltage ? first_without_voltage_ : first_gain_)) {
      fast_.take_gain(gain);
    } else {
      p_.bus().refuse();
      if (std::exchange(not_plausible_k_, gain.k) == gain.k) given_up_k_ = gain.k;
    }
    tick_while_ready();
  }
  void tick_while_ready() {
    while (!waiting_.empty() && (!must_wait(waiting_.front().k) || waiting_.size() > kQueueLimit)) {
      const Measurement m = waiting_.front();
      waiting_.pop_front();
      tick(m);
    }
  }
  // A gain whose snapshot was never taken, because its sample was lost on the way, is not waited
  // for.
  bool must_wait(std::int64_t k) const {
    if (!p_.lockstep() || fast_.gain_ready(k)) return false;
    const Estimate* snapshot = planned_snapshot(k);
    return snapshot && snapshot->k != given_up_k_;
  }
  const Estimate* planned_snapshot(std::int64_t k) const {
    return snapshots_.at(snapshot_for_tick(fast_.policy(), k, fast_.rate()));
  }
  void tick(const Measurement& m) {
    while (!coming_.empty() && m.k >= coming_.front().first) {
      fast_.exchange(std::move(coming_.front().second));
      coming_.pop_front();
    }
    if (m.k >= restart_k_ || (!resets_.empty() && m.k >= resets_.front())) restart(m.k);
    drive_is_off_ = m.mode == Mode::kSafe;
    policy_ = fast_.policy();  // of this tick: a change holds from the next one on
    last_ = fast_.tick(m);
    p_.bus().publish(to_wire(last_, p_.bus().session()));
    if (is_snapshot(m.k, fast_.rate())) snapshots_.put(last_);
    report(last_);
    p_.progress(m.k);
  }
  void report(const Estimate& e) {
    const bool every_tick = (e.status & kGainEveryTick) != 0;
    if (gain_every_tick_ && !every_tick) {
      p_.gains_every_nth(fast_.rate());
      p_.event(Reason::kGainEveryNth, e.k, kAgreedText);
    }
    gain_every_tick_ = every_tick;
    const bool late = (e.status & kLateGain) != 0;
    if (late) ++p_.status().late_gains;
    if (late && !was_late_)
      p_.event(Reason::kLateGain, e.k,
               fmt::format("a gain was late: the gain of tick {} is held", e.gain_seq));
    was_late_ = late;
    const bool fell_back = (e.status & kScheduledGain) != 0 && has_background(policy_);
    if (fell_back && !had_fallen_back_)
      p_.event(Reason::kGainScheduled, e.k,
               "no new gain for longer than gain.max_age_ticks: the gain comes from the table over "
               "speed");
    if (!fell_back && had_fallen_back_)
      p_.event(Reason::kGainBack, e.k,
               fmt::format("new gains arrive: the gain of tick {} is used", e.gain_seq));
    had_fallen_back_ = fell_back;
    if ((e.status & kGapBridged) != 0)
      p_.event(Reason::kMeasurementGap, e.k,
               "samples were missing; the filter predicted over them");
    if ((e.status & kNotFinite) != 0)
      p_.event(Reason::kEstimateNotFinite, e.k, "a correction was not finite and was not applied");
  }
  void repeat_what_is_waited_for() {
    if (waiting_.empty()) return;
    const Estimate* snapshot = planned_snapshot(waiting_.front().k);
    if (!snapshot) return;
    ++p_.status().repeats;
    p_.bus().publish(to_wire(*snapshot, p_.bus().session()));
  }
  // The log lacks a gain: perhaps the gain process never saw the snapshot. No later tick may be
  // there to ask for it.
  void repeat_snapshots(const ack_t& ack) {
    for (int i = 0; i < ack.n_missing && i < 32; ++i)
      if (ack.missing_channel[i] == static_cast<int>(Channel::kGain))
        p_.bus().send_again(Channel::kEstimate, ack.missing_seq[i]);
  }

  Process& p_;
  FastLoop fast_;
  Gain first_gain_, first_without_voltage_;
  Estimate last_;
  Recent<Estimate> snapshots_;
  std::deque<Measurement> waiting_;
  std::deque<std::pair<std::int64_t, std::shared_ptr<const Filter>>> coming_;  // by first tick
  bool drive_is_off_ = false;
  std::int64_t restarted_k_ = -1;
  std::deque<std::int64_t> resets_;                      // that the drive file plans
  std::int64_t restart_k_ = INT64_MAX;                   // tick of a pending reset
  std::int64_t not_plausible_k_ = -1, given_up_k_ = -1;  // snapshots
  GainPolicy policy_ = GainPolicy::kPaper;
  std::shared_ptr<const GainSchedule> schedule_;  // for a change to policy scheduled
  bool was_late_ = false, had_fallen_back_ = false, gain_every_tick_ = false;
};

}  // namespace

int run_estimator(const char* program, int argc, char** argv, const MakeFilter& make) {
  return run_process(
      {Role::kEstimator, program, "MEASUREMENT, GAIN -> [fast step at f_s] -> ESTIMATE"}, argc,
      argv, [&](Process& p) { EstimatorProcess(p, make).run(); });
}

}  // namespace twinrate

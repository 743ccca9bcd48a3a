// The control law as a process.
//
// The reference comes from the config's profile and is published as DRIVE_REFERENCE, unless another
// process publishes it (reference.from_bus). A tick that arrives again is answered from memory.
// Only ESTIMATE wakes the process: the other inputs of a tick arrive before it, or are waited for
// after it.
#include "controller/controller_process.hpp"

#include <fmt/format.h>

#include <deque>

#include "core/process.hpp"
#include "core/recent.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

class ControllerProcess {
 public:
  ControllerProcess(Process& p, const MakeController& make)
      : p_(p),
        make_(make),
        controller_(make(p.config(), Begin::kAsConfigured)),
        own_reference_(!p.drive().reference.from_bus),
        needs_truth_(p.drive().controller.angle_source == AngleSource::kTruth) {
    p.bus().subscribe<measurement_t>(
        [this](const measurement_t& w) {
          if (cannot_be(w.seq)) return p_.bus().refuse();
          m_.put(from_wire(w));
          step_when_complete();
        },
        Wake::kQuiet);
    p.bus().subscribe<estimate_t>([this](const estimate_t& w) { take(from_wire(w)); });
    if (!own_reference_)
      p.bus().subscribe<reference_t>(
          [this](const reference_t& w) {
            if (cannot_be(w.seq)) return p_.bus().refuse();
            if (p_.in_turn() && w.seq <= last_.k) return;
            r_ = from_wire(w);
            step_when_complete();
          },
          Wake::kQuiet);
    if (needs_truth_)
      p.bus().subscribe<truth_t>(
          [this](const truth_t& w) {
            if (cannot_be(w.seq)) return p_.bus().refuse();
            truth_.put(from_wire(w));
            step_when_complete();
          },
          Wake::kQuiet);
    p.waiting_for([this] { return missing(); });
    p.on_new_model([this](Config& extended) {
      return [this, effects = extended.drive().model_effects()](std::int64_t k) {
        coming_.emplace_back(k, effects);
      };
    });
    p.on_reset([this](std::int64_t k) { return reset(k); });
    const auto planned = planned_resets(p.config());
    resets_.assign(planned.begin(), planned.end());
    p.on_steering({.follow = [this](const SteeredDrive& now) {
      controller_->follow_compensation(now.drive().controller.compensation);
    }});
  }
  void run() {
    p_.ready();
    p_.run();
    if (!told_learnt_) tell_learnt();  // stopped before the last tick
  }

 private:
  Waiting missing() const {
    const std::int64_t k = last_.k + 1;
    if (!m_.at(k))
      return {fmt::format("MEASUREMENT({})", k), Patience::kForMeasurement, Role::kPlant};
    if (e_.k < k) return {fmt::format("ESTIMATE({})", k), Patience::kForEstimate, Role::kEstimator};
    if (needs_truth_ && !truth_.at(k))
      return {fmt::format("TRUTH({})", k), Patience::kForEstimate, Role::kPlant};
    return {fmt::format("REFERENCE({}) from its generator", k), Patience::kForEstimate};
  }
  void take(const Estimate& e) {
    if (e.k == last_.k && last_.k >= 0) {
      answer_again();
    } else if (cannot_be(e.k)) {
      p_.bus().refuse();
    } else if (e.k > last_.k) {
      e_ = e;
      step_when_complete();
    }
  }
  std::string reset(std::int64_t k) {
    if (!drive_is_off_) return "the drive is not off";
    restart_k_ = k;
    return "";
  }
  void restart(std::int64_t k) {
    restart_k_ = INT64_MAX;
    while (!resets_.empty() && k >= resets_.front()) resets_.pop_front();
    controller_ = make_(p_.config(), Begin::kAfterReset);
    if (known_) controller_->know(*known_);
  }
  // A tick that only the next COMMAND can cause.
  bool cannot_be(std::int64_t k) const { return p_.in_turn() && k > last_.k + 1; }
  void answer_again() {
    ++p_.status().duplicates;
    p_.bus().publish(to_wire(last_, p_.bus().session()));
  }
  void step_when_complete() {
    step_if_complete();
    p_.bus().wake_for_all(e_.k > last_.k);
  }
  void step_if_complete() {
    const std::int64_t k = e_.k;
    const Measurement* m = m_.at(k);
    const Truth* truth = needs_truth_ ? truth_.at(k) : nullptr;
    if (k <= last_.k || !m || (needs_truth_ && !truth)) return;
    if (own_reference_)
      r_ = p_.steered().drive().reference_at(k);
    else if (r_.k < 0 || (p_.lockstep() && r_.k != k))
      return;
    while (!coming_.empty() && k >= coming_.front().first) {
      known_ = coming_.front().second;
      controller_->know(*known_);
      coming_.pop_front();
    }
    if (k >= restart_k_ || (!resets_.empty() && k >= resets_.front())) restart(k);
    drive_is_off_ = m->mode == Mode::kSafe;
    last_ = controller_->step({*m, e_, r_, truth});
    const std::int64_t session = p_.bus().session();
    p_.bus().publish(to_wire(last_, session));
    if (own_reference_) p_.bus().publish_later(to_wire(r_, session));
    const ControllerEvent event = controller_->take_event();
    if (event.reason != Reason::kNone) p_.event(event.reason, k, event.text);
    if (k == p_.drive().steps() - 1) tell_learnt();
    p_.progress(k);
  }
  void tell_learnt() {
    told_learnt_ = true;
    if (const std::string learnt = controller_->learnt(); !learnt.empty() && last_.k >= 0)
      p_.event(Reason::kLearnt, last_.k, learnt);
  }

  Process& p_;
  MakeController make_;
  std::unique_ptr<Controller> controller_;
  bool own_reference_, needs_truth_, told_learnt_ = false;
  Recent<Measurement> m_;
  Recent<Truth> truth_;
  Estimate e_;
  Reference r_;
  Command last_;
  std::deque<std::pair<std::int64_t, Effects>> coming_;  // by first tick
  std::optional<Effects> known_;                         // of the last that came
  bool drive_is_off_ = false;
  std::deque<std::int64_t> resets_;     // that the drive file plans
  std::int64_t restart_k_ = INT64_MAX;  // tick of a pending reset
};

}  // namespace

int run_controller(const char* program, int argc, char** argv, const MakeController& make) {
  return run_process({Role::kController, program,
                      "MEASUREMENT, ESTIMATE, REFERENCE -> [controller step at f_s] -> COMMAND"},
                     argc, argv, [&](Process& p) { ControllerProcess(p, make).run(); });
}

}  // namespace twinrate

// twinrate-controller: the control law.
//
//   MEASUREMENT(k), ESTIMATE(k), REFERENCE(k) -> [Controller::step] -> COMMAND(k)
//
// The reference comes from the config's profile and is published as DRIVE_REFERENCE, unless
// reference.from_bus says that another process publishes it. A tick that arrives again is answered
// from memory.
#include <fmt/format.h>

#include <deque>

#include "controller/make_controller.hpp"
#include "core/process.hpp"
#include "core/recent.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

class ControllerProcess {
 public:
  explicit ControllerProcess(Process& p)
      : p_(p),
        controller_(make_controller(p.config())),
        own_reference_(!p.drive().reference.from_bus),
        needs_truth_(p.drive().controller.angle_source == AngleSource::kTruth) {
    p.bus().subscribe<measurement_t>([this](const measurement_t& w) {
      if (cannot_be(w.seq)) return p_.bus().refuse();
      m_.put(from_wire(w));
      step_when_complete();
    });
    p.bus().subscribe<estimate_t>([this](const estimate_t& w) { take(from_wire(w)); });
    if (!own_reference_)
      p.bus().subscribe<reference_t>([this](const reference_t& w) {
        if (cannot_be(w.seq)) return p_.bus().refuse();
        if (p_.in_turn() && w.seq <= last_.k) return;
        r_ = from_wire(w);
        step_when_complete();
      });
    if (needs_truth_)
      p.bus().subscribe<truth_t>([this](const truth_t& w) {
        if (cannot_be(w.seq)) return p_.bus().refuse();
        truth_.put(from_wire(w));
        step_when_complete();
      });
    p.waiting_for([this] { return missing(); });
    p.on_new_model([this](Config& extended, std::int64_t k) {
      coming_.emplace_back(k, extended.drive().model_effects());
    });
  }
  void run() {
    p_.ready();
    p_.run();
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
  // A tick that only the next COMMAND can cause.
  bool cannot_be(std::int64_t k) const { return p_.in_turn() && k > last_.k + 1; }
  void answer_again() {
    ++p_.status().duplicates;
    p_.bus().publish(to_wire(last_, p_.bus().session()));
  }
  void step_when_complete() {
    const std::int64_t k = e_.k;
    const Measurement* m = m_.at(k);
    const Truth* truth = needs_truth_ ? truth_.at(k) : nullptr;
    if (k <= last_.k || !m || (needs_truth_ && !truth)) return;
    if (own_reference_)
      r_ = p_.drive().reference_at(k);
    else if (r_.k < 0 || (p_.lockstep() && r_.k != k))
      return;
    while (!coming_.empty() && k >= coming_.front().first) {
      controller_->know(coming_.front().second);
      coming_.pop_front();
    }
    last_ = controller_->step({*m, e_, r_, truth});
    if (own_reference_) p_.bus().publish(to_wire(r_, p_.bus().session()));
    p_.bus().publish(to_wire(last_, p_.bus().session()));
    const ControllerEvent event = controller_->take_event();
    if (event.reason != Reason::kNone) p_.event(event.reason, k, event.text);
    if (k == p_.drive().steps() - 1)
      if (const std::string learnt = controller_->learnt(); !learnt.empty())
        p_.event(Reason::kLearnt, k, learnt);
    p_.progress(k);
  }

  Process& p_;
  std::unique_ptr<Controller> controller_;
  bool own_reference_, needs_truth_;
  Recent<Measurement> m_;
  Recent<Truth> truth_;
  Estimate e_;
  Reference r_;
  Command last_;
  std::deque<std::pair<std::int64_t, Effects>> coming_;  // by first tick
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kController, "twinrate-controller",
                      "MEASUREMENT, ESTIMATE, REFERENCE -> [controller step at f_s] -> COMMAND"},
                     argc, argv, [](Process& p) { ControllerProcess(p).run(); });
}

// twinrate-estimator: the fast correction loop.
//
//   MEASUREMENT(k), GAIN(s) -> [FastLoop::tick] -> ESTIMATE(k)
//
// Lock-step: the tick waits for the gain it plans to use, so the result does not depend on scheduling. While it
// waits it repeats the snapshot the gain is computed from. Realtime: nobody waits, the older gain is held and counted.
#include <fmt/format.h>

#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {
namespace {

class EstimatorProcess {
 public:
  explicit EstimatorProcess(Process& p)
      : p_(p),
        fast_(make_filter(p.config()), p.drive().gain.policy, p.drive().rates.n) {
    p.bus().subscribe<gain_t>([this](const gain_t& w) { take_gain(from_wire(w)); });
    p.bus().subscribe<measurement_t>([this](const measurement_t& w) { take(from_wire(w)); });
    p.bus().on_new_session([this] { reset(-1); });
    p.waiting_for([this] { return missing(); });
  }
  void run() {
    p_.ready();
    p_.run([this] { repeat_what_is_waited_for(); });
  }

 private:
  std::string missing() const {
    return waiting_.k >= 0 ? fmt::format("GAIN for tick {} from gain", waiting_.k)
                           : fmt::format("MEASUREMENT({}) from plant", last_.k + 1);
  }
  void reset(std::int64_t k) {
    fast_.reset();
    last_ = Estimate{};
    waiting_ = Measurement{};
    p_.event(Reason::kEstimatorReset, k, "the sequence started again: the filter began anew");
  }
  void take(const Measurement& m) {
    if (m.k == last_.k || m.k == waiting_.k) {
      ++p_.status().duplicates;
      if (m.k == last_.k) p_.bus().publish(to_wire(last_, p_.bus().session()));
      return;
    }
    if (m.k < last_.k) {
      if (!p_.options().follow) return;
      reset(m.k);
    }
    if (p_.lockstep() && !fast_.gain_ready(m.k))
      waiting_ = m;
    else
      tick(m);
  }
  void take_gain(const Gain& gain) {
    fast_.take_gain(gain);
    if (waiting_.k < 0 || !fast_.gain_ready(waiting_.k)) return;
    const Measurement m = waiting_;
    waiting_ = Measurement{};
    tick(m);
  }
  void tick(const Measurement& m) {
    last_ = fast_.tick(m);
    p_.bus().publish(to_wire(last_, p_.bus().session()));
    if (is_snapshot(m.k, p_.drive().rates.n)) snapshot_ = last_;
    report(last_);
    p_.progress(m.k);
  }
  void report(const Estimate& e) {
    const bool late = (e.status & kLateGain) != 0;
    if (late) ++p_.status().late_gains;
    if (late && !was_late_)
      p_.event(Reason::kLateGain, e.k, fmt::format("a gain was late: the one of tick {} is held", e.gain_seq));
    was_late_ = late;
    if ((e.status & kGapBridged) != 0)
      p_.event(Reason::kMeasurementGap, e.k, "samples were missing; the filter predicted over them");
    if ((e.status & kNotFinite) != 0)
      p_.event(Reason::kEstimateNotFinite, e.k, "a correction was not finite and was left out");
  }
  void repeat_what_is_waited_for() {
    if (waiting_.k < 0 || snapshot_.k < 0) return;
    ++p_.status().repeats;
    p_.bus().publish(to_wire(snapshot_, p_.bus().session()));
  }

  Process& p_;
  FastLoop fast_;
  Estimate last_, snapshot_;
  Measurement waiting_;
  bool was_late_ = false;
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kEstimator, "twinrate-estimator",
                      "MEASUREMENT, GAIN -> [fast step at f_s] -> ESTIMATE"},
                     argc, argv, [](Process& p) { EstimatorProcess(p).run(); });
}

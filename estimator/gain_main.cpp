// twinrate-gain: the slow background computation of gain and covariance.
//
//   ESTIMATE(s), s = 0, n, 2n .. -> [BackgroundLoop::step] -> GAIN(s)
//
// A snapshot that arrives again is answered from memory. With policy `scheduled` there is nothing
// to compute and nothing is published.
#include <fmt/format.h>

#include <deque>

#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {
namespace {

class GainProcess {
 public:
  explicit GainProcess(Process& p)
      : p_(p), background_(make_background_loop(p.config())), rates_(rate_history(p.config())) {
    if (has_background(p.drive().gain.policy)) p.bus().want_estimates(p.drive().background_rate());
    want_snapshots();
    p.bus().subscribe<estimate_t>([this](const estimate_t& w) { take(from_wire(w)); });
    p.bus().on_new_session([this] { background_.reset(); });
    p.on_new_model([this](Config& extended) {
      return [this, filter = std::shared_ptr<const Filter>(make_filter(extended))](std::int64_t k) {
        coming_.emplace_back(k, filter);
      };
    });
    p.on_steering({.follow = [this](const SteeredDrive& now) {
      rates_ = now.rates();
      background_.follow(rates_.changes());
      want_snapshots();
    }});
    p.waiting_for([this] {
      return Waiting{fmt::format("snapshot ESTIMATE({})", next_k()), Patience::kForSnapshot,
                     Role::kEstimator};
    });
  }
  void run() {
    p_.ready();
    p_.run();
  }

 private:
  void want_snapshots() {
    for (const RateChange& change : rates_.changes()) p_.bus().want_estimates(change.rate());
  }
  std::int64_t last_k() const { return background_.last().k; }
  // After a policy without background: the change to one with a background.
  std::int64_t next_k() const {
    std::int64_t k = background_.next_k();
    for (const RateChange& change : rates_.changes())
      if (change.k > k && !has_background(rates_.policy_at(k))) k = change.k;
    return k;
  }
  void take(const Estimate& e) {
    if (!has_background(rates_.policy_at(e.k))) return p_.progress(e.k);
    if (!rates_.sends_gain(e.k, e.status)) return;
    if (e.k == last_k()) {
      ++p_.status().duplicates;
      p_.bus().publish(to_wire(background_.last(), p_.bus().session()));
      return;
    }
    if (!background_.fits(e)) return p_.bus().refuse();
    if (p_.in_turn() && e.k > next_k()) return p_.bus().refuse();
    if (e.k < last_k()) {
      if (!p_.options().follow) return;
      background_.reset();
    }
    while (!coming_.empty() && e.k >= coming_.front().first) {
      background_.exchange(std::move(coming_.front().second));
      coming_.pop_front();
    }
    p_.bus().publish(to_wire(background_.step(e), p_.bus().session()));
    p_.progress(e.k);
  }

  Process& p_;
  BackgroundLoop background_;
  RateHistory rates_;
  std::deque<std::pair<std::int64_t, std::shared_ptr<const Filter>>> coming_;  // by first tick
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kGain, "twinrate-gain", "ESTIMATE -> [background step at f_b] -> GAIN"},
                     argc, argv, [](Process& p) { GainProcess(p).run(); });
}

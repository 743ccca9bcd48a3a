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
  explicit GainProcess(Process& p) : p_(p), background_(make_background_loop(p.config())) {
    p.bus().subscribe<estimate_t>([this](const estimate_t& w) { take(from_wire(w)); });
    p.bus().on_new_session([this] { background_.reset(); });
    p.on_new_model([this](Config& extended, std::int64_t k) {
      coming_.emplace_back(k, make_filter(extended));
    });
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
  std::int64_t last_k() const { return background_.last().k; }
  std::int64_t next_k() const { return background_.next_k(); }
  void take(const Estimate& e) {
    if (!has_background(p_.drive().gain.policy)) return p_.progress(e.k);
    if (!p_.drive().sends_gain(e)) return;
    if (e.k == last_k()) {
      ++p_.status().duplicates;
      p_.bus().publish(to_wire(background_.last(), p_.bus().session()));
      return;
    }
    if (e.n_x < background_.last().n_x) return p_.bus().refuse();
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
  std::deque<std::pair<std::int64_t, std::shared_ptr<const Filter>>> coming_;  // by first tick
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kGain, "twinrate-gain", "ESTIMATE -> [background step at f_b] -> GAIN"},
                     argc, argv, [](Process& p) { GainProcess(p).run(); });
}

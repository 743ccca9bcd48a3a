#include "embedded/cortex_process.hpp"

#include <fmt/format.h>

#include "core/process.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

class CortexProcess {
 public:
  CortexProcess(Process& p, CortexLink link, double period_s)
      : p_(p),
        gains_({Role::kGain, "cortex_m3", "the background of the processor"}, p.options()),
        device_(fixed_settings(p.config()), link, period_s, true) {
    if (!p.lockstep()) throw BadInput("--pace: lockstep allowed with the emulated Cortex-M3");
    p.bus().subscribe<measurement_t>([this](const measurement_t& w) { take(from_wire(w)); });
    for (Process* both : {&p_, &gains_}) {
      both->waiting_for([this] {
        return Waiting{fmt::format("MEASUREMENT({})", last_.k + 1), Patience::kForMeasurement,
                       Role::kPlant};
      });
      both->on_steering({.check =
                             [](const SteeredDrive& wanted, std::int64_t) {
                               if (!wanted.rates().changes().empty())
                                 throw BadInput(
                                     "n, policy: the Cortex-M3 keeps those of its start");
                             },
                         .follow = [](const SteeredDrive&) {}});
      both->on_new_model(
          [](Config&) -> Process::UseModel { throw BadInput("the Cortex-M3 has no effects"); });
    }
    p.on_reset([](std::int64_t) -> std::string { return "the Cortex-M3 has no reset"; });
  }

  void run() {
    gains_.ready();
    p_.ready();
    while (p_.turn(p_.repeat_after_ms()) && gains_.turn(0)) {
    }
    if (!gains_.stopping()) gains_.finish();
  }

 private:
  void take(const Measurement& m) {
    if (m.k == last_.k) {
      ++p_.status().duplicates;
      return p_.bus().publish(to_wire(last_, p_.bus().session()));
    }
    if (m.k != last_.k + 1) return p_.bus().refuse();
    const m3::Answer& answer = device_.tick(m);
    last_ = estimate_of(estimate_of(answer), m, p_.drive().machine.n_p);
    p_.bus().publish(to_wire(last_, p_.bus().session()));
    p_.progress(m.k);
    publish_gain();
    // After the last tick no further answer carries its gain.
    while (m.k + 1 == p_.drive().steps() && gain_k_ < newest_snapshot(m.k)) {
      device_.ask(m.k);
      publish_gain();
    }
    if (answer.late > 0)
      throw std::runtime_error(fmt::format(
          "tick {}: the background of the Cortex-M3 is late, its period is too short for n = {}",
          m.k, p_.drive().rates.n));
  }
  std::int64_t newest_snapshot(std::int64_t k) const {
    while (k >= 0 && !p_.drive().sends_gain(k, 0)) --k;
    return k;
  }
  void publish_gain() {
    const m3::NewGain* raw = device_.new_gain();
    gains_.progress(last_.k);
    if (!raw) return;
    gain_k_ = raw->k;
    gains_.bus().publish(to_wire(gain_of(*raw, p_.drive()), p_.bus().session()));
  }

  Process& p_;
  Process gains_;
  CortexDevice device_;
  Estimate last_;
  std::int64_t gain_k_ = -1;
};

}  // namespace

int run_cortex_process(int argc, char** argv, CortexLink link, double period_s) {
  return run_process(
      {Role::kEstimator, "cortex_m3", "MEASUREMENT -> [emulated Cortex-M3] -> ESTIMATE, GAIN"},
      argc, argv, [&](Process& p) { CortexProcess(p, link, period_s).run(); });
}

}  // namespace twinrate

// twinrate-plant: the simulated plant and the clock of the run.
//
//   COMMAND(k) -> [Plant::advance] -> MEASUREMENT(k+1), TRUTH(k+1)
//
// Lock-step: simulated time; a tick ends when COMMAND(k) is there; an unanswered MEASUREMENT is
// sent again; the plant is never more than bus.window_ticks ahead of the log. Realtime: absolute
// clock, nobody waits.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"
#include "plant_sim/plant.hpp"
#include "plant_sim/realtime.hpp"

namespace twinrate {
namespace {

class PlantProcess {
 public:
  explicit PlantProcess(Process& p)
      : p_(p),
        plant_(p.config()),
        steps_(p.drive().steps()),
        truth_is_awaited_(p.drive().controller.angle_source == AngleSource::kTruth) {
    p.bus().subscribe<command_t>([this](const command_t& w) { take(from_wire(w)); });
    p.bus().subscribe<ack_t>([this](const ack_t& ack) { take_ack(ack); });
    p.on_emergency_stop([this] { plant_.emergency_stop(); });
    p.on_reset([this](std::int64_t k) { return plant_.reset(k); });
    p.waiting_for([this] { return missing(); });
    p.on_steering({.follow = [this](const SteeredDrive& now) {
      plant_.follow_load(now.drive().load.T_load_Nm);
    }});
    p.arbitrate([this] { return p_.lockstep() ? sent_ + 1 : k(); },
                [this] {
                  if (p_.lockstep() && !p_.stopping() && running_ && sent_ < k()) go_on();
                });
    if (!p.bus().bound()) p.bus().adopt(new_session_id());
  }
  void run() {
    p_.ready();
    while (p_.options().wait_for_start && p_.turn(50)) {
    }
    if (p_.stopping()) return;
    if (p_.lockstep()) {
      running_ = true;
      begun_ = Clock::now();
      go_on();
      if (p_.options().wall)
        run_with_the_clock();
      else
        p_.run([this] { repeat(); });
    } else {
      run_realtime(p_, plant_, steps_);
      drain_log();
    }
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr auto kLagMax = std::chrono::milliseconds(50);

  Waiting missing() const {
    if (sent_ < k() && p_.holds(k()))
      return {fmt::format("the answers to a request for tick {}", k()), Patience::kForCommand};
    if (k() < steps_ && sent_ == k())
      return {fmt::format("COMMAND({})", k()), Patience::kForCommand, Role::kController};
    return {fmt::format("an acknowledgement of tick {} (the log stands at {})",
                        std::min(k(), steps_), acknowledged_),
            Patience::kForCommand, Role::kLogger};
  }
  std::int64_t k() const { return plant_.k(); }
  void publish_tick() {
    const std::int64_t session = p_.bus().session();
    if (truth_is_awaited_) {
      p_.bus().publish(to_wire(plant_.sample(), session), to_wire(plant_.truth(), session));
    } else {
      p_.bus().publish(to_wire(plant_.sample(), session));
      p_.bus().publish_later(to_wire(plant_.truth(), session));
    }
    sent_ = k();
  }
  // A command that is not finite is requested again; the second time the last one is held.
  bool must_ask_again(const Command& command) {
    if (is_finite(command)) return false;
    p_.bus().refuse();
    return std::exchange(not_finite_k_, command.k) != command.k;
  }
  // Without tags a message has no sender: two commands of one tick that differ are those of two.
  void refuse_second(const Command& command) {
    p_.bus().refuse();
    if (command.k < second_k_ + static_cast<std::int64_t>(p_.drive().rates.f_s_Hz)) return;
    second_k_ = command.k;
    p_.event(Reason::kSecondSender, command.k,
             fmt::format("a second, different COMMAND({}) was refused", command.k));
  }
  void take(const Command& command) {
    if (command.k > k()) return p_.bus().refuse();
    if (plant_.contradicts(command)) return refuse_second(command);
    if (must_ask_again(command)) return;
    plant_.take_command(command);
    if (!p_.lockstep() || command.k != k() || sent_ != k()) return;
    try {  // no exception crosses an LCM callback
      plant_.advance();
    } catch (const std::exception& error) {
      p_.fail(Reason::kPlantFailed, k(), error.what());
      return;
    }
    publish_safety_events(p_, plant_, command.k);
    p_.progress(command.k);
    go_on();
  }
  // The next tick, or the end, as soon as the log has caught up.
  void go_on() {
    const bool ended = k() >= steps_;
    const std::int64_t may_reach = acknowledged_ + p_.bus_parameters().window_ticks;
    if (ended ? (logged_ && acknowledged_ < steps_) : (logged_ && k() >= may_reach)) return;
    if (!ended && (p_.holds(k()) || ahead_of_the_clock())) return;
    if (ended)
      p_.finish();
    else
      publish_tick();
  }
  void take_ack(const ack_t& ack) {
    if (ack.seq > k() + 1) return p_.bus().refuse();
    logged_ = true;
    acknowledged_ = std::max(acknowledged_, ack.seq);
    if (p_.lockstep() && !p_.stopping() && sent_ >= 0 && sent_ < k()) go_on();
  }
  Clock::time_point due() const { return begun_ + std::chrono::nanoseconds(p_.drive().t_ns(k())); }
  // Pace wall. A drive that cannot keep up does not make up for it: after a lag of kLagMax its clock
  // is set back.
  bool ahead_of_the_clock() {
    if (!p_.options().wall) return false;
    const auto now = Clock::now();
    if (now - due() > kLagMax) begun_ += now - due();
    return now < due();
  }
  void run_with_the_clock() {
    auto last_sent = Clock::now();
    for (std::int64_t seen = sent_; !p_.stopping();) {
      const bool waits_for_clock = sent_ < k() && ahead_of_the_clock();
      const std::chrono::duration<double, std::milli> to_due = due() - Clock::now();
      p_.turn(waits_for_clock ? std::clamp(to_due.count(), 0.0, p_.repeat_after_ms())
                              : p_.repeat_after_ms());
      if (p_.stopping()) return;
      if (sent_ < k()) go_on();
      if (sent_ != seen || waits_for_clock) {
        seen = sent_;
        last_sent = Clock::now();
      } else if (1e3 * seconds_since(last_sent) >= p_.repeat_after_ms()) {
        repeat();
        last_sent = Clock::now();
      }
    }
  }
  // Repeats the unanswered tick, or the last one while the log is behind: it may have missed the
  // whole tick.
  void repeat() {
    ++p_.status().repeats;
    p_.bus().send_again(Channel::kMeasurement, sent_);
    p_.bus().send_again(Channel::kTruth, sent_);
  }
  // Realtime: the loop has ended; the logger may still be writing. A logger that writes nothing for
  // a second is assumed to be gone.
  void drain_log() {
    auto last = std::chrono::steady_clock::now();
    for (std::int64_t seen = acknowledged_; logged_ && acknowledged_ < k() && p_.turn(20);) {
      if (acknowledged_ != seen) last = std::chrono::steady_clock::now();
      seen = acknowledged_;
      if (seconds_since(last) > 1) break;
    }
    if (!p_.stopping()) p_.finish();
  }

  Process& p_;
  Plant plant_;
  std::int64_t steps_, sent_ = -1, acknowledged_ = 0, not_finite_k_ = -1;
  std::int64_t second_k_ = INT64_MIN / 2;  // of the last report
  bool truth_is_awaited_;                  // by the controller
  bool logged_ = false;                    // a logger of this session has spoken
  bool running_ = false;
  Clock::time_point begun_{};  // pace wall: of drive time 0
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process(
      {Role::kPlant, "twinrate-plant", "COMMAND -> [simulated drive] -> MEASUREMENT, TRUTH"}, argc,
      argv, [](Process& p) { PlantProcess(p).run(); });
}

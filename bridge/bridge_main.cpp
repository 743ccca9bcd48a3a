// twinrate-bridge: a real drive behind the channels of the simulated plant.
//
//   COMMAND(k) -> [link] -> drive -> [link] -> MEASUREMENT(k+1)
//
// Lock-step: the drive (an emulated one) waits for each command, and a tick ends when its next
// sample arrives. Realtime: the drive sets the pace, and nobody waits. In mode listen only the
// greeting is sent. When the bridge ends, its last frame switches the outputs off.
#include <fmt/format.h>

#include "bridge/conversation.hpp"
#include "bridge/guard.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

constexpr double kGreet_s = 5;

class BridgeProcess {
 public:
  explicit BridgeProcess(Process& p)
      : p_(p),
        bridge_(p.config().read<BridgeParameters>()),
        talk_(bridge_, p.drive()),
        guard_(p.config(), bridge_),
        steps_(p.drive().steps()),
        listens_(bridge_.mode == BridgeMode::kListen) {
    p.bus().subscribe<command_t>([this](const command_t& w) { take(from_wire(w)); });
    p.bus().subscribe<ack_t>([this](const ack_t& ack) {
      logged_ = true;
      acknowledged_ = std::max(acknowledged_, std::min(ack.seq, k_ + 1));
    });
    p.on_emergency_stop([this] { guard_.emergency_stop(); });
    p.on_reset([](std::int64_t) -> std::string {
      return "a real drive is cleared by hand: twinrate bridge probe --clear";
    });
    p.waiting_for([this] { return missing(); });
    if (!p.bus().bound()) p.bus().adopt(new_session_id());
  }

  void run() {
    if (!listens_) greet();
    p_.ready();
    while (p_.options().wait_for_start && p_.turn(p_.lockstep() || listens_ ? 20 : 0)) discard();
    if (p_.stopping()) return;
    if (listens_) greet();  // an emulated drive begins with it: not before every listener is there
    warn_without_watchdog();
    if (p_.lockstep() && !listens_)
      run_lockstep();
    else
      run_live();
    say_account();
    drain_log();
  }

 private:
  void greet() {
    const DriveInfo& info = talk_.greet(p_.lockstep() && !listens_, kGreet_s);
    if (p_.lockstep() && !listens_ && !info.lockstep)
      throw BadInput(
          "bridge.mode: control of a drive that sets its own pace: --pace realtime allowed");
  }
  // Discards samples before the start, except the one with which a drive in lock-step waits.
  void discard() {
    if (listens_) return;
    talk_.pump(1);
    if (p_.lockstep()) return;
    while (talk_.next()) {
    }
  }
  Waiting missing() const {
    if (!drive_has_command_)
      return {fmt::format("COMMAND({})", k_), Patience::kForCommand, Role::kController};
    return {fmt::format("sample {} of the drive", k_ + 1), Patience::kForCommand};
  }
  void warn_without_watchdog() {
    if (listens_ || bridge_.device_has_watchdog()) return;
    p_.event(Reason::kNoDeviceWatchdog, k_,
             "the drive has no watchdog in this mode and keeps its last command if the host ends: "
             "not safe");
  }

  // ---- samples ----
  // `read`: the part of the sample that the processes may use.
  void publish(const DriveSample& sample, const Measurement& read) {
    if (first_k_ < 0) {
      first_k_ = sample.m.k;
      first_sampled_us_ = sample.sampled_us.value_or(0);
    }
    Measurement m = read;
    m.k -= first_k_;
    m.t_ns = sample.sampled_us ? std::llround(1e3 * (*sample.sampled_us - first_sampled_us_))
                               : p_.drive().t_ns(m.k);
    k_ = m.k;
    device_k_ = sample.m.k;
    drive_has_command_ = false;
    p_.bus().publish(to_wire(m, p_.bus().session()));
  }
  // Samples of a drive in mode listen are logged unchanged.
  Measurement guard(const DriveSample& sample, Arrival arrival) {
    const std::int64_t resets = talk_.protocol().counts().resets;
    if (resets > resets_) guard_.restarted();
    resets_ = resets;
    const Measurement read = listens_ ? sample.m : guard_.take(sample, arrival, mode_);
    report();
    return read;
  }
  void report() {
    for (const GuardEvent& event : guard_.take_events())
      p_.event(event.reason, std::max<std::int64_t>(k_, 0), event.text);
    const LinkCounts& c = talk_.protocol().counts();
    // In lock-step a sample that was requested again comes twice.
    const std::int64_t disturbed = c.disturbed() - (p_.lockstep() ? c.doubled : 0);
    if (disturbed == disturbed_ || now_ns() - disturbed_said_ns_ < 1'000'000'000) return;
    disturbed_ = disturbed;
    disturbed_said_ns_ = now_ns();
    p_.event(Reason::kLinkDisturbed, std::max<std::int64_t>(k_, 0),
             fmt::format("frames damaged {}, lost {}, doubled {}, late {} so far", c.damaged,
                         c.lost, c.doubled, c.late));
  }

  // ---- commands ----
  void take(const Command& command) {
    if (listens_ || command.k > k_ || k_ < 0) return p_.bus().refuse();
    if (command.k <= answered_) return;
    if (!command.u_alphabeta_ref.allFinite() || !std::isfinite(command.theta_ctrl)) {
      not_finite_ = true;
      return p_.bus().refuse();
    }
    answered_ = command.k;
    mode_ = command.mode;
    send(command);
    p_.progress(command.k);
  }
  void send(const Command& command) {
    drive_has_command_ = true;
    sent_ns_ = now_ns();
    if (guard_.is_off() || command.mode == Mode::kSafe) return talk_.off();
    talk_.command({.command = command,
                   .sample_k = device_k_ - (k_ - command.k),
                   .lease_us = static_cast<std::uint32_t>(1e3 * bridge_.lease_ms)});
  }
  Arrival arrival() {
    if (answered_ < 0) return Arrival::kNotDue;
    const bool came = answered_ > answered_before_;
    answered_before_ = answered_;
    return came                                ? Arrival::kInTime
           : std::exchange(not_finite_, false) ? Arrival::kNotFinite
                                               : Arrival::kMissing;
  }

  // ---- lock-step ----
  void run_lockstep() {
    while (!p_.stopping() && k_ + 1 < steps_) {
      if (!may_publish() || (k_ >= 0 && !drive_has_command_)) {
        p_.turn(std::min(5.0, p_.repeat_after_ms()));
        repeat_measurement();
        continue;
      }
      if (!talk_.pump(1) && !repeat_command()) break;
      if (const auto sample = talk_.next()) {
        publish(*sample, guard(*sample, arrival()));
        published_ns_ = now_ns();
      }
      p_.turn(0);
    }
    while (!p_.stopping() && !drive_has_command_) {  // of the last tick
      p_.turn(5);
      repeat_measurement();
    }
  }
  bool may_publish() const {
    return !logged_ || k_ + 1 < acknowledged_ + p_.bus_parameters().window_ticks;
  }
  void repeat_measurement() {
    if (1e-6 * static_cast<double>(now_ns() - published_ns_) < p_.repeat_after_ms()) return;
    published_ns_ = now_ns();
    ++p_.status().repeats;
    p_.bus().send_again(Channel::kMeasurement, k_);
  }
  // False if the link is lost.
  bool repeat_command() {
    const std::int64_t since = now_ns() - sent_ns_;
    guard_.silent_for(talk_.silent_ms());
    if (!talk_.link().is_open()) guard_.silent_for(1e9);
    if (talk_.silent_ms() > bridge_.silence_ms || !talk_.link().is_open()) {
      report();
      p_.fail(Reason::kLinkLost, k_, "the link to the drive is lost");
      return false;
    }
    if (k_ >= 0 && 1e-6 * static_cast<double>(since) > p_.repeat_after_ms()) {
      sent_ns_ = now_ns();
      ++p_.status().repeats;
      talk_.repeat();
    }
    return true;
  }

  // ---- realtime ----
  void run_live() {
    while (!listens_ && talk_.next()) {
    }
    const double supervisor_ms = p_.config().read<SafetyParameters>().supervisor_ms;
    while (!p_.stopping() && k_ + 1 < steps_) {
      talk_.pump(0.1);
      while (const auto sample = talk_.next()) take_live(*sample);
      if (!p_.lockstep() && p_.supervisor_silent_s().value_or(0) > 1e-3 * supervisor_ms)
        guard_.supervisor_is_silent();
      if (!watch_link()) break;
      p_.turn(0);
    }
    if (!listens_) talk_.off();
  }
  void take_live(const DriveSample& sample) {
    if (k_ + 1 >= steps_) return;
    const Arrival came = arrival();
    if (came == Arrival::kMissing && !listens_ && !guard_.is_off()) ++p_.status().late_commands;
    publish(sample, guard(sample, came));
    if (listens_) p_.progress(k_);
    if (!listens_ && guard_.is_off()) talk_.off();
  }
  // False if the run ends.
  bool watch_link() {
    constexpr double kEndOfStream_ms = 1000;
    const double silent = talk_.link().is_open() ? talk_.silent_ms() : 1e9;
    if (!listens_) {
      guard_.silent_for(silent);
      report();
      if (guard_.is_off() && silent > 5 * bridge_.silence_ms) {
        p_.fail(Reason::kLinkLost, k_, "the link to the drive is lost");
        return false;
      }
      return true;
    }
    if (k_ < 0 || silent < std::max(kEndOfStream_ms, bridge_.silence_ms)) return true;
    p_.event(Reason::kLinkDisturbed, k_, "the drive fell silent: the log ends here");
    return false;
  }

  // ---- end ----
  void say_account() {
    fmt::print(stderr, "twinrate-bridge: {}\n", talk_.account());
    if (p_.options().run_dir.empty()) return;
    try {
      write_new(p_.options().run_dir + "/link.json", talk_.to_json());
    } catch (const std::runtime_error& error) {
      fmt::print(stderr, "twinrate-bridge: {}\n", error.what());
    }
  }
  void drain_log() {
    std::int64_t seen = acknowledged_, since = now_ns();
    while (logged_ && acknowledged_ < k_ + 1 && p_.turn(5)) {
      if (acknowledged_ != seen) seen = acknowledged_, since = now_ns();
      repeat_measurement();
      if (now_ns() - since > 2'000'000'000) break;
    }
    if (!p_.stopping()) p_.finish();
  }

  Process& p_;
  BridgeParameters bridge_;
  Conversation talk_;
  BridgeGuard guard_;
  std::int64_t steps_;
  bool listens_;
  std::int64_t k_ = -1, first_k_ = -1, device_k_ = -1;  // of the last sample
  double first_sampled_us_ = 0;
  std::int64_t answered_ = -1, answered_before_ = -1;  // commands from the bus
  std::int64_t acknowledged_ = 0, sent_ns_ = now_ns(), published_ns_ = now_ns();
  std::int64_t resets_ = 0, disturbed_ = 0, disturbed_said_ns_ = 0;
  bool drive_has_command_ = true, logged_ = false, not_finite_ = false;
  Mode mode_ = Mode::kRun;
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kPlant, "twinrate-bridge", "COMMAND -> [real drive] -> MEASUREMENT"},
                     argc, argv, [](Process& p) { BridgeProcess(p).run(); });
}

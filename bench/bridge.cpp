// Faults of line and device behind the bridge, and the round trip over a pty: the tables of
// docs/bridge.md.
//
//   bridge_bench faults     each fault 20 times, in simulated time: equal on every machine
//   bridge_bench pty [S]    SAMPLE out, COMMAND back, at 5 kHz for S seconds (default 10): of this machine
//   bridge_bench ticks RUN  exit code 0 where each MEASUREMENT of the log has a later tick than the one before
#include <fmt/format.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>

#include "bridge/link.hpp"
#include "core/decode.hpp"
#include "core/event_log.hpp"
#include "core/report_error.hpp"
#include "emulator/rehearsal.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

constexpr int kTimes = 20;

struct Outcome {
  bool detected = false, counted = false, off = false, runs_on = false, recovered = false;
  double off_after_s = 0, lease_s = 0;
};

struct Case {
  const char* name;
  bool must_end;  // outputs off; else the drive runs on
  std::function<void(RehearsalFaults&, double at_s)> make;
  // Counted exactly as often as it happened; none: as the events of its reason, one.
  std::function<bool(const Rehearsal&)> counted = {};
  Reason reason = Reason::kNone;  // that the host or the drive names
  std::vector<std::string> overrides = {};
  bool emergency_stop = false;  // the host asks for it at that moment
};

std::int64_t events_of(const Rehearsal& r, Reason reason) {
  return std::count_if(r.events.begin(), r.events.end(),
                       [&](const GuardEvent& e) { return e.reason == reason; });
}

Outcome run_once(const Case& c, int time) {
  const double at_s = 0.06 + 0.0053 * time;  // after the first agreement of the estimate
  std::vector<std::string> overrides = c.overrides;
  overrides.insert(overrides.end(), {"plant.kind=bridge", "reference.omega_e_rad_s=200"});
  for (std::string& text : overrides)
    if (const auto at = text.find("AT"); at != std::string::npos)
      text.replace(at, 2, fmt::format("{}", at_s));
  Config config = load_drive("dilys2021", overrides);
  const BridgeParameters bridge = config.read<BridgeParameters>();
  RehearsalFaults faults;
  c.make(faults, at_s);
  Rehearsal r(config, bridge, faults, static_cast<unsigned>(time) + 1);
  if (c.emergency_stop) {
    r.run_until(at_s);
    r.emergency_stop();
  }
  r.run_until(0.5);
  Outcome o;
  o.counted = c.counted ? c.counted(r) : events_of(r, c.reason) == 1;
  o.detected = c.reason == Reason::kNone
                   ? o.counted
                   : events_of(r, c.reason) > 0 || r.drive().latched() == c.reason;
  o.off = r.off_after_s() >= 0;
  o.off_after_s = r.off_after_s();
  o.lease_s = 1e-3 * bridge.lease_ms;
  o.runs_on = !r.guard().is_off() && r.drive().latched() == Reason::kNone &&
              r.drive().sample()->omega_m > 40;
  if (c.must_end) {
    r.restart_host(true);
    r.run_until(0.5014);  // seven ticks
    o.recovered =
        r.drive().latched() == Reason::kNone && r.drive().sample()->u_alphabeta.norm() > 0;
  }
  return o;
}

// One direction of the line is broken, until shortly before the end.
void pull(LineFaults& line, double at) {
  line.pulled_at_s = at;
  line.pulled_for_s = 0.49 - at;
}

// In time for a delay of two, and seen to need it.
bool takes_two_ticks(const LinkCounts& c) {
  return c.answer_ticks_mean() > 1.1 && c.answer_ticks_most == 2 && c.command_late == 0;
}

std::vector<Case> faults_that_run_on() {
  using R = const Rehearsal&;
  using F = RehearsalFaults&;
  return {
      {"bit errors, 1 in 50,000", false,
       [](F f, double) { f.up.bit_errors = f.down.bit_errors = 2e-5; },
       [](R r) { return r.host().counts().damaged > 0 && r.device().bad_frames() > 0; }},
      {"1 % of the frames lost", false, [](F f, double) { f.up.lost = f.down.lost = 0.01; },
       [](R r) { return r.host().counts().lost > 0 && r.device().lost_frames() > 0; }},
      {"1 % doubled", false, [](F f, double) { f.up.doubled = f.down.doubled = 0.01; },
       [](R r) { return r.host().counts().doubled > 0; }},
      {"1 % reordered", false, [](F f, double) { f.up.reordered = f.down.reordered = 0.01; },
       [](R r) { return r.host().counts().late > 0; }},
      {"latency of 0.15 ms each way", false,
       [](F f, double) { f.up.latency_s = f.down.latency_s = 0.15e-3; },
       [](R r) { return r.host().counts().command_late > 1000; }},
      {"the same with `plant.delay_samples = 2`",
       false,
       [](F f, double) { f.up.latency_s = f.down.latency_s = 0.15e-3; },
       [](R r) { return takes_two_ticks(r.host().counts()); },
       Reason::kNone,
       {"plant.delay_samples=2"}},
      {"jitter of 0.15 ms each way", false,
       [](F f, double) { f.up.jitter_s = f.down.jitter_s = 0.15e-3; },
       [](R r) { return r.host().counts().command_late > 100; }},
      {"the same with `plant.delay_samples = 2`",
       false,
       [](F f, double) { f.up.jitter_s = f.down.jitter_s = 0.15e-3; },
       [](R r) { return takes_two_ticks(r.host().counts()); },
       Reason::kNone,
       {"plant.delay_samples=2"}},
      {"device clock 100 ppm fast", false, [](F f, double) { f.drift_ppm = 100; },
       [](R r) { return std::abs(r.host().clock().drift() + 100e-6) < DeviceClock::kDriftBound; }},
  };
}

std::vector<Case> faults_that_end() {
  using F = RehearsalFaults&;
  const auto nothing = [](F, double) {};
  return {
      {"cable pulled",
       true,
       [](F f, double at) { pull(f.up, at), pull(f.down, at); },
       {},
       Reason::kLinkLost},
      {"cable pulled, `bridge.lease_ms = 3`",
       true,
       [](F f, double at) { pull(f.up, at), pull(f.down, at); },
       {},
       Reason::kLinkLost,
       {"bridge.lease_ms=3"}},
      {"line to the drive broken",
       true,
       [](F f, double at) { pull(f.down, at); },
       {},
       Reason::kCommandLost},
      {"line from the drive broken",
       true,
       [](F f, double at) { pull(f.up, at); },
       {},
       Reason::kLinkLost},
      {"host process dies", true, [](F f, double at) { f.host_ends_at_s = at; },
       [](const Rehearsal& r) { return r.device().leases_ended() == 1; }, Reason::kCommandLost},
      {"estimator process dies",
       true,
       [](F f, double at) { f.estimator_ends_at_s = at; },
       {},
       Reason::kCommandLost},
      {"estimator out of synchronism (`controller.foc.synchronism.watch`)",
       true,
       nothing,
       {},
       Reason::kSafeRequested,
       {"controller.foc.synchronism.watch=true", "machine.i_trip_A=30", "load.slew_Nm_s=0",
        "load.T_load_Nm=[[0,0],[AT,0.2]]"}},
      {"reading of the drive implausible: NaN",
       true,
       nothing,
       {},
       Reason::kSensorLost,
       {"plant.fault.kind=current_nan", "plant.fault.at_s=AT", "plant.fault.for_s=0.1"}},
      {"the same: 10 A off",
       true,
       nothing,
       {},
       Reason::kSensorLost,
       {"plant.fault.kind=current_jump", "plant.fault.value=10", "plant.fault.at_s=AT",
        "plant.fault.for_s=0.1"}},
      {"reading implausible, and the drive does not watch it: NaN",
       true,
       [](F f, double at) { f.misread_from_s = at, f.misread_A = std::nan(""); },
       {},
       Reason::kSensorLost,
       {}},
      {"the same: 10 A off",
       true,
       [](F f, double at) { f.misread_from_s = at, f.misread_A = 10; },
       {},
       Reason::kSensorLost,
       {}},
      {"drive restarts", true, [](F f, double at) { f.device.reset_at_s = at; },
       [](const Rehearsal& r) { return r.host().counts().resets == 1; }, Reason::kDeviceReset},
      {"emergency stop at the host", true, nothing, {}, Reason::kEmergencyStop, {}, true},
      {"over-current in the drive",
       true,
       nothing,
       {},
       Reason::kOverCurrent,
       {"machine.i_trip_A=0.3"}},
      {"over-voltage of the bus",
       true,
       nothing,
       {},
       Reason::kOverVoltage,
       {"plant.fault.kind=bus_voltage", "plant.fault.at_s=AT", "plant.fault.value=40",
        "plant.fault.for_s=0.1"}},
      {"over-speed", true, nothing, {}, Reason::kOverSpeed, {"safety.omega_m_max_rad_s=30"}},
      {"emergency stop, and the drive keeps its last command",
       true,
       [](F f, double) { f.device.keeps_last = true; },
       {},
       Reason::kDeviceDisobeys,
       {},
       true},
  };
}

void print_row(const Case& c) {
  int detected = 0, counted = 0, right = 0, recovered = 0;
  double slowest = -1;
  for (int time = 0; time < kTimes; ++time) {
    const Outcome o = run_once(c, time);
    detected += o.detected;
    counted += o.counted;
    // The lease, and the tick at which the voltage of the interval before is seen.
    right += c.must_end ? o.off && o.off_after_s <= o.lease_s + 0.0004 : o.runs_on;
    recovered += o.recovered;
    slowest = std::max(slowest, o.off_after_s);
  }
  fmt::print("| {} | {} | {} | {} {} | {} | {} |\n", c.name, detected, counted, right,
             c.must_end ? "off" : "run on",
             slowest < 0 || !c.must_end ? "-" : fmt::format("{:.1f}", 1e3 * slowest),
             c.must_end && right > 0 ? std::to_string(recovered) : "-");
  std::fflush(stdout);
}

void faults() {
  fmt::print(
      "| fault, 20 times | found | counted | outcome | off after, ms | cleared by hand |\n"
      "|---|---|---|---|---|---|\n");
  for (const Case& c : faults_that_run_on()) print_row(c);
  for (const Case& c : faults_that_end()) print_row(c);
}

// ---- log ----

bool has_each_tick_once(const std::string& run_dir) {
  std::int64_t before = -1;
  bool once = true;
  EventLog events(run_dir, OnDamage::kRefuse);
  while (const lcm::LogEvent* event = events.next()) {
    measurement_t m{};
    if (events.channel() != Channel::kMeasurement ||
        !decode(m, event->data, static_cast<std::size_t>(event->datalen)))
      continue;
    once = once && m.seq > before;
    before = m.seq;
  }
  return once && before >= 0;
}

// ---- round trip ----

struct Echo {
  std::unique_ptr<Link> link;
  std::atomic<bool> stop{false};
  std::vector<double> us;
  std::int64_t sent = 0, lost = 0;

  void run(double seconds) {
    constexpr std::int64_t kPeriod_ns = 200'000;
    twp_receiver receiver{};
    const std::int64_t begun = now_ns();
    std::vector<std::int64_t> sent_ns;
    for (std::int64_t k = 0; now_ns() - begun < static_cast<std::int64_t>(1e9 * seconds); ++k) {
      const timespec due{(begun + k * kPeriod_ns) / 1'000'000'000,
                         (begun + k * kPeriod_ns) % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr);
      twp_frame f{};
      f.header = {.type = TWP_SAMPLE,
                  .flags = TWP_CURRENTS | TWP_VOLTAGE | TWP_BUS,
                  .seq = static_cast<std::uint32_t>(k)};
      std::uint8_t wire[TWP_MAX_WIRE];
      sent_ns.push_back(now_ns());
      link->send({wire, twp_write(&f, wire)});
      hear(receiver, sent_ns, 0.1);
    }
    for (int i = 0; i < 200; ++i) hear(receiver, sent_ns, 1);
    sent = static_cast<std::int64_t>(sent_ns.size());
    lost = sent - static_cast<std::int64_t>(us.size());
  }
  void hear(twp_receiver& receiver, const std::vector<std::int64_t>& sent_ns, double wait_ms) {
    for (const std::uint8_t byte : link->receive(wait_ms)) {
      twp_frame f{};
      if (twp_receive(&receiver, byte, &f) != TWP_FRAME || f.header.type != TWP_COMMAND) continue;
      const auto k = static_cast<std::size_t>(f.body.command.sample_seq);
      if (k < sent_ns.size()) us.push_back(1e-3 * static_cast<double>(now_ns() - sent_ns[k]));
    }
  }
};

void round_trip(double seconds) {
  const std::string path =
      (std::filesystem::temp_directory_path() / fmt::format("bridge-bench-{}", getpid())).string();
  Echo device{.link = make_pty(path)};
  const auto link = open_link(path, 3000000);
  TwinrateHost host(false);
  std::thread thread([&] { device.run(seconds), device.stop = true; });
  while (!device.stop) {
    host.take(link->receive(1), now_ns());
    while (const auto sample = host.next())
      link->send(host.command({.sample_k = sample->m.k, .lease_us = 20000}));
  }
  thread.join();
  std::sort(device.us.begin(), device.us.end());
  const auto at = [&](double share) {
    return device.us[static_cast<std::size_t>(share * static_cast<double>(device.us.size() - 1))];
  };
  fmt::print(
      "pty at 5 kHz, {} frames of 54 bytes out and 42 back: p50 {:.0f} us, p99 {:.0f} us, "
      "p99.9 {:.0f} us, worst {:.0f} us, not answered {}\n",
      device.sent, at(0.5), at(0.99), at(0.999), device.us.back(), device.lost);
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "faults")
    twinrate::faults();
  else if (what == "pty")
    twinrate::round_trip(argc > 2 ? std::atof(argv[2]) : 10);
  else if (what == "ticks" && argc > 2)
    return twinrate::has_each_tick_once(argv[2]) ? 0 : 1;
  else
    return fmt::print(stderr, "bridge_bench faults | pty [SECONDS] | ticks RUN_DIR\n"), 2;
  return 0;
} catch (...) {
  return twinrate::report_error("bridge");
}

#include "emulator/rehearsal.hpp"

#include <algorithm>
#include <cmath>

#include "controller/make_controller.hpp"

namespace twinrate {
namespace {

DeviceOptions device_options(const DriveConfig& d, const BridgeParameters& bridge,
                             const DeviceFaults& faults) {
  return {.name = d.name,
          .T_s = d.T_s(),
          .lease_max_s = 1e-3 * bridge.lease_ms,
          .delay = d.plant.delay_samples,
          .faults = faults};
}

}  // namespace

Rehearsal::Rehearsal(Config& config, const BridgeParameters& bridge, const RehearsalFaults& faults,
                     unsigned seed)
    : config_(config),
      bridge_(bridge),
      faults_(faults),
      drive_(config),
      device_(device_options(config.drive(), bridge, faults.device), drive_),
      up_(faults.up, seed),
      down_(faults.down, seed + 1) {
  restart_host(false);
}

void Rehearsal::restart_host(bool by_hand) {
  host_ = std::make_unique<TwinrateHost>(bridge_.float64, config_.drive().plant.delay_samples);
  guard_ = std::make_unique<BridgeGuard>(config_, bridge_);
  estimator_ = std::make_unique<EstimatorLoop>(config_);
  controller_ = make_controller(config_);
  last_arrival_ns_ = t_ns_;
  resets_ = 0;
  first_k_ = -1;
  ticks_.clear();
  answered_ = false;
  for (double* at_s :
       {&faults_.host_ends_at_s, &faults_.estimator_ends_at_s, &faults_.misread_from_s})
    if (t_s() >= *at_s) *at_s = 1e9;
  send(host_->hello(false));
  if (by_hand) send(host_->clear(static_cast<int>(drive_.latched())));
}

double Rehearsal::off_after_s() const {
  return off_at_s_ < 0 ? -1 : off_at_s_ - last_command_s_;
}

// `now_s` is device time. With a positive drift the periods of the device are shorter in host time.
void Rehearsal::device_tick() {
  const double now_s = static_cast<double>(device_.k()) * config_.drive().T_s();
  const std::uint32_t before = device_.leased_commands();
  device_.take(down_.receive(t_ns_));
  if (device_.leased_commands() != before) last_command_s_ = now_s;
  device_.tick();
  for (const Bytes& frame : device_.take_sent()) up_.send(frame, t_ns_);
  const bool on = drive_.sample()->u_alphabeta.norm() > 0;
  if (on) off_at_s_ = -1;
  if (!on && off_at_s_ < 0 && last_command_s_ >= 0) off_at_s_ = now_s;
}

void Rehearsal::answer(DriveSample sample) {
  if (t_s() >= faults_.misread_from_s) sample.m.i_abc[0] += faults_.misread_A;
  ticks_.push_back(sample.m.k);
  last_arrival_ns_ = sample.arrival_ns;
  if (host_->counts().resets > resets_) {
    resets_ = host_->counts().resets;
    guard_->restarted();
  }
  sample.m = guard_->take(sample,
                          first_k_ < 0 ? Arrival::kNotDue
                          : answered_  ? Arrival::kInTime
                                       : Arrival::kMissing,
                          mode_);
  for (GuardEvent& event : guard_->take_events()) events.push_back(std::move(event));
  if (guard_->is_off()) return send(host_->off());
  if (first_k_ < 0) first_k_ = sample.m.k;
  answered_ = t_s() < faults_.estimator_ends_at_s;
  if (!answered_) return;
  Measurement m = sample.m;
  m.k -= first_k_;
  m.t_ns = config_.drive().t_ns(m.k);
  estimate_ = estimator_->tick(m);
  const Command c = controller_->step({m, estimate_, config_.drive().reference_at(m.k)});
  mode_ = c.mode;
  if (mode_ == Mode::kSafe) return send(host_->off());
  send(host_->command({.command = c,
                       .sample_k = sample.m.k,
                       .lease_us = static_cast<std::uint32_t>(1e3 * bridge_.lease_ms)}));
}

void Rehearsal::host_receives(std::int64_t t_ns) {
  t_ns_ = t_ns;
  host_->take(up_.receive(t_ns), t_ns);
  while (const auto sample = host_->next()) answer(*sample);
}

void Rehearsal::run_until(double t_s) {
  const auto end_ns = static_cast<std::int64_t>(std::llround(1e9 * t_s));
  const double tick_ns = 1e9 * config_.drive().T_s() / (1 + 1e-6 * faults_.drift_ppm);
  while (true) {
    const auto due =
        static_cast<std::int64_t>(std::llround(static_cast<double>(device_.k()) * tick_ns));
    const std::int64_t arrival = up_.next_arrival();
    const std::int64_t next = std::min(due, arrival);
    if (next >= end_ns) break;
    const bool host_runs = 1e-9 * static_cast<double>(next) < faults_.host_ends_at_s;
    if (arrival <= due && host_runs) {
      host_receives(arrival);
      continue;
    }
    t_ns_ = next;
    if (arrival <= due) up_.receive(arrival);  // the host has ended
    if (due <= arrival) device_tick();
    if (host_runs) guard_->silent_for(1e-6 * static_cast<double>(t_ns_ - last_arrival_ns_));
    for (GuardEvent& event : guard_->take_events()) events.push_back(std::move(event));
  }
  t_ns_ = end_ns;
}

}  // namespace twinrate

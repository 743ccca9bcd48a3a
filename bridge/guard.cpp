#include "bridge/guard.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace twinrate {
namespace {

SafetyLimits limits_of(Config& config, const BridgeParameters& bridge) {
  const double ticks = 1e-3 * bridge.lease_ms * config.drive().rates.f_s_Hz;
  auto safety = config.read<SafetyParameters>();
  safety.hold_ms = bridge.lease_ms;
  return safety_limits(config, safety, std::max(1, static_cast<int>(ticks)));
}

}  // namespace

BridgeGuard::BridgeGuard(Config& config, const BridgeParameters& bridge)
    : silence_ms_(bridge.silence_ms),
      v_dc_nominal_(config.drive().inverter.v_dc),
      machine_(limits_of(config, bridge)),
      watch_(sensor_limits(config.drive(), machine_.limits())),
      needs_position_(config.drive().controller.angle_source == AngleSource::kMeasured) {}

void BridgeGuard::go_off(Reason reason, const std::string& text) {
  if (!off_) events_.push_back({reason, text});
  off_ = true;
}

void BridgeGuard::silent_for(double silent_ms) {
  if (silent_ms > silence_ms_)
    go_off(Reason::kLinkLost,
           fmt::format("no frame of the drive for {:.0f} ms, bridge.silence_ms = {:g}: off",
                       silent_ms, silence_ms_));
}

// A drive whose outputs are off shows no voltage. Below a percent of the bus it may be noise of a
// measured one.
void BridgeGuard::watch_obedience(const DriveSample& sample) {
  const bool drives = (sample.m.signals & kVoltage) != 0 && !sample.off &&
                      sample.m.u_alphabeta.norm() > 0.01 * std::abs(sample.m.v_dc);
  ticks_off_ = off_ && drives ? ticks_off_ + 1 : 0;
  if (ticks_off_ < kObeyTicks || std::exchange(disobeyed_, true)) return;
  events_.push_back({Reason::kDeviceDisobeys,
                     fmt::format("the drive applies {:.3g} V although it was switched off: cut its "
                                 "power",
                                 sample.m.u_alphabeta.norm())});
}

int BridgeGuard::watch_readings(Measurement& m) {
  SensorReadings r{{m.i_abc[0], m.i_abc[1], m.i_abc[2]}, m.v_dc, m.theta_m, m.omega_m};
  const bool measured = (m.signals & kPhaseCurrents) != 0;
  const int faults = watch_.check(r, {m.u_alphabeta.norm(), m.theta_forced}, measured);
  if (measured) {
    m.i_abc = {r.i_abc[0], r.i_abc[1], r.i_abc[2]};
    m.v_dc = r.v_dc, m.theta_m = r.theta_m, m.omega_m = r.omega_m;
  }
  if (faults & kBusNotFinite) m.signals &= ~kBusVoltage;
  if (faults & kAnyPositionFault) m.signals &= ~(kPosition | kSpeed);
  const int counted = needs_position_ ? faults : faults & ~kAnyPositionFault;
  if (counted & (kAnyCurrentFault | kAnyPositionFault)) m.signals &= kVoltage | kBusVoltage;
  return counted;
}

Measurement BridgeGuard::take(const DriveSample& sample, Arrival command, Mode mode) {
  Measurement m = sample.m;
  watch_obedience(sample);
  if (sample.off && !std::exchange(device_was_off_, true)) {
    const char* name = reason_name(sample.reason);
    go_off(name ? static_cast<Reason>(sample.reason) : Reason::kSafeRequested,
           fmt::format("the drive is off by itself: {}",
                       name ? name : fmt::format("code {}", sample.reason)));
  }
  const bool knows_bus = (m.signals & kBusVoltage) != 0;
  SafetyInput in;
  in.arrival = command;
  in.asked = mode == Mode::kSafe  ? Asked::kSafe
             : mode == Mode::kRun ? Asked::kRun
                                  : Asked::kForcedAngle;
  in.faulty = watch_readings(m);
  in.i = std::hypot(m.i_abc[0], (m.i_abc[1] - m.i_abc[2]) / std::sqrt(3.0));
  in.v_dc = knows_bus ? m.v_dc : v_dc_nominal_;
  in.omega_m = m.omega_m;
  in.emergency_stop = stop_;
  in.supervisor_silent = supervisor_silent_;
  machine_.step(in);
  for (int i = 0; i < machine_.event_count(); ++i) {
    const SafetyEvent& event = machine_.event(i);
    if (event.reason == Reason::kSensorFault)
      events_.push_back({event.reason, "bridge: " + text_of(event, machine_)});
    if (event.to == DriveState::kSafe && event.from != DriveState::kSafe)
      go_off(event.reason, "bridge: " + text_of(event, machine_));
  }
  return m;
}

std::vector<GuardEvent> BridgeGuard::take_events() {
  return std::exchange(events_, {});
}

}  // namespace twinrate

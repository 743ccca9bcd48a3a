#include "loop/runnable_bridge.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "core/bridge_parameters.hpp"
#include "core/steering.hpp"
#include "loop/unused_keys.hpp"

namespace twinrate {
namespace {

// The default of bridge.lease_ms; a shorter one is the user's claim about the link.
constexpr double kDefaultLease_ms = 20;

// Checks the lease against the duration of a message on the line; the remaining delay needs a
// measurement.
std::string lease_too_short(const Config& config, const BridgeParameters& bridge) {
  const double frames_ms = 1e3 * bridge.wire_time_s();
  const double least_ms =
      BridgeParameters::kLeaseRoundTrips * std::max(frames_ms, 1e3 * config.drive().T_s());
  if (bridge.lease_ms < least_ms)
    return fmt::format(
        "{:g} ms is shorter than the link can hold: {:g} ticks of {:.3g} ms ({:.3g} ms for a "
        "sample on the wire); it needs {:.3g} ms",
        bridge.lease_ms, BridgeParameters::kLeaseRoundTrips, 1e3 * config.drive().T_s(), frames_ms,
        least_ms);
  if (bridge.lease_ms >= kDefaultLease_ms) return "";
  return fmt::format(
      "{:g} ms holds where the p99.9 of the round trip is below {:.3g} ms: `twinrate bridge probe` "
      "measures it",
      bridge.lease_ms, bridge.lease_ms / BridgeParameters::kLeaseRoundTrips);
}

}  // namespace

void require_drivable(Config& config) {
  const BridgeParameters bridge = config.read<BridgeParameters>();
  const DriveConfig& d = config.drive();
  if (d.plant.kind != PlantKind::kBridge) return;
  const auto fail = [&](const char* key, const std::string& what) {
    throw BadInput(fmt::format("{}: {}: {}", config.where(key), key, what));
  };
  const SteeringParameters steering = steering_of(config);
  for (const ProfileStep& step : steering.emergency.steps())
    if (step.value != 0)
      fail("steering.emergency",
           "none allowed with plant.kind = bridge: `twinrate set emergency_stop` and `set reset` "
           "stop and reset a running drive");
  if (d.controller.angle_source == AngleSource::kTruth)
    fail("controller.angle_source", "estimate, measured allowed with plant.kind = bridge");
  if (bridge.mode != BridgeMode::kControl) return;
  if (bridge.protocol == DriveProtocol::kVesc)
    fail("bridge.mode", "listen allowed with bridge.protocol = vesc: it takes no voltage vector");
  if (!bridge.device_has_watchdog() && !bridge.without_watchdog)
    fail("bridge.moteus_control",
         "voltage allowed with bridge.without_watchdog = true: the drive keeps its last command if "
         "the host ends");
}

std::vector<std::string> warnings_of_the_bridge(Config& config) {
  const BridgeParameters bridge = config.read<BridgeParameters>();
  std::vector<std::string> list;
  if (config.drive().plant.kind != PlantKind::kBridge) return list;
  if (const std::string unread = keys_unread_by_a_real_drive(config); !unread.empty())
    list.push_back(fmt::format("unused keys: a real drive (bridge.mode = {}) does not read {}",
                               kBridgeModeNames[static_cast<int>(bridge.mode)], unread));
  if (const double wire_s = bridge.wire_time_s(), T_s = config.drive().T_s();
      bridge.protocol == DriveProtocol::kTwinrate && !bridge.port.empty() && wire_s > T_s)
    list.push_back(
        fmt::format("{}: bridge.baud: a sample takes up to {:.3g} ms on the line, a tick {:.3g} "
                    "ms: in realtime "
                    "samples are lost",
                    config.where("bridge.baud"), 1e3 * wire_s, 1e3 * T_s));
  if (!bridge.tells_voltage())
    list.push_back(fmt::format(
        "{}: bridge.moteus_listen: uart tells no voltage: the drive is logged without estimates",
        config.where("bridge.moteus_listen")));
  if (bridge.mode != BridgeMode::kControl) return list;
  if (!bridge.device_has_watchdog())
    list.push_back(
        fmt::format("{}: bridge.moteus_control: voltage is not safe: the drive has no watchdog in "
                    "this mode and "
                    "keeps its last command if the host or the cable fails",
                    config.where("bridge.moteus_control")));
  else if (const std::string why = lease_too_short(config, bridge); !why.empty())
    list.push_back(fmt::format("{}: bridge.lease_ms: {}", config.where("bridge.lease_ms"), why));
  return list;
}

}  // namespace twinrate

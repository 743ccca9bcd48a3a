#include <random>

#include "bridge/moteus_host.hpp"
#include "bridge/twinrate_host.hpp"
#include "bridge/vesc_host.hpp"
#include "core/config.hpp"

namespace twinrate {

std::unique_ptr<HostProtocol> make_protocol(const BridgeParameters& bridge,
                                            const DriveConfig& drive) {
  switch (bridge.protocol) {
    case DriveProtocol::kTwinrate:
      break;
    case DriveProtocol::kMoteus:
      if (bridge.moteus_listen == MoteusListen::kUart) {
        if (bridge.mode == BridgeMode::kControl)
          throw BadInput("bridge.moteus_listen: poll allowed with bridge.mode = control");
        return std::make_unique<MoteusBurst>(bridge, drive);
      }
      return std::make_unique<MoteusHost>(bridge, drive);
    case DriveProtocol::kVesc:
      return std::make_unique<VescHost>(bridge, drive);
  }
  return std::make_unique<TwinrateHost>(bridge.float64, drive.plant.delay_samples,
                                        std::random_device{}());
}

}  // namespace twinrate

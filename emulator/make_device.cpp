#include "emulator/moteus_device.hpp"
#include "emulator/twinrate_device.hpp"
#include "emulator/vesc_device.hpp"

namespace twinrate {

std::unique_ptr<EmulatedDevice> make_device(const DeviceOptions& options, EmulatedDrive& drive,
                                            const DriveConfig& config) {
  switch (options.protocol) {
    case DriveProtocol::kTwinrate:
      break;
    case DriveProtocol::kMoteus:
      if (options.moteus_listen == MoteusListen::kUart)
        return std::make_unique<MoteusBurstDevice>(drive, config.machine);
      return std::make_unique<MoteusDevice>(options, drive, config.machine);
    case DriveProtocol::kVesc:
      return std::make_unique<VescDevice>(options, drive, config.machine);
  }
  return std::make_unique<TwinrateDevice>(options, drive);
}

}  // namespace twinrate

#include "core/bridge_parameters.hpp"

namespace twinrate {

void BridgeParameters::fields(FieldVisitor& f) {
  f.text("port", port, "serial device (/dev/ttyACM0) or udp://HOST:PORT");
  f.choice("protocol", protocol, kDriveProtocolNames, "protocol of the drive");
  f.choice("mode", mode, kBridgeModeNames,
           "control: the host closes the loop; listen: the drive runs its own control");
  f.integer("baud", baud, 9600, 4000000, "rate of a serial line");
  f.number("lease_ms", lease_ms, 1, 1000,
           "the drive switches off after this time without a command");
  f.number("silence_ms", silence_ms, 5, 60000,
           "the link counts as lost after this time without a frame of the drive");
  f.boolean("float64", float64, "protocol twinrate: frames hold float64 instead of float32");
  f.boolean("emulate", emulate, "launch starts twinrate-emulator and runs on it");
  f.integer("moteus_id", moteus_id, 1, 127, "CAN id of the moteus");
  f.choice("moteus_control", moteus_control, kMoteusControlNames,
           "torque: position mode with gains of 0; voltage: needs bridge.without_watchdog");
  f.choice("moteus_listen", moteus_listen, kMoteusListenNames,
           "poll: registers over the fdcanusb; uart: the burst of the debug UART");
  f.number("theta_e_offset_rad", theta_e_offset, -10, 10,
           "moteus, vesc: electrical angle of the d axis where the drive's own angle is 0");
  f.boolean("without_watchdog", without_watchdog,
            "allow a mode in which the drive keeps its last command if the host ends: not safe");
}

bool BridgeParameters::device_has_watchdog() const {
  return protocol == DriveProtocol::kTwinrate ||
         (protocol == DriveProtocol::kMoteus && moteus_control == MoteusControl::kTorque);
}

bool BridgeParameters::takes_commands() const {
  return protocol != DriveProtocol::kVesc && tells_voltage();
}

bool BridgeParameters::tells_voltage() const {
  return protocol != DriveProtocol::kMoteus || moteus_listen != MoteusListen::kUart;
}

// A sample of every group is the longest frame of the twinrate protocol (docs/bridge-protocol.md); a
// moteus answers a line of 64 bytes in hexadecimal.
double BridgeParameters::wire_time_s() const {
  if (port.starts_with("udp://") || emulate) return 0;
  const int bytes = protocol == DriveProtocol::kTwinrate ? (float64 ? 126 : 78) : 150;
  return 10.0 * bytes / baud;
}

}  // namespace twinrate

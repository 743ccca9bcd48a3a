// [bridge] of a drive file: connection of the host to a real drive, and limits of its commands.
#pragma once
#include <string>

#include "model/fields.hpp"

namespace twinrate {

enum class DriveProtocol : int { kTwinrate = 0, kMoteus = 1, kVesc = 2 };
inline constexpr const char* kDriveProtocolNames[] = {"twinrate", "moteus", "vesc"};

// control: the host closes the loop. listen: the drive runs its own control.
enum class BridgeMode : int { kControl = 0, kListen = 1 };
inline constexpr const char* kBridgeModeNames[] = {"control", "listen"};

// Commands to a moteus: torque through its position mode, which has a watchdog, or voltages,
// without a watchdog.
enum class MoteusControl : int { kTorque = 0, kVoltage = 1 };
inline constexpr const char* kMoteusControlNames[] = {"torque", "voltage"};

// How to read a moteus: its registers over the fdcanusb, or the burst of its debug UART.
enum class MoteusListen : int { kPoll = 0, kUart = 1 };
inline constexpr const char* kMoteusListenNames[] = {"poll", "uart"};

struct BridgeParameters {
  static constexpr const char* kTable = "bridge";
  // A lease bridges a slow round trip and two lost frames.
  static constexpr double kLeaseRoundTrips = 3;
  std::string port;
  DriveProtocol protocol = DriveProtocol::kTwinrate;
  BridgeMode mode = BridgeMode::kControl;
  int baud = 3000000;
  double lease_ms = 20, silence_ms = 200;
  bool float64 = true;
  bool emulate = false;
  int moteus_id = 1;
  MoteusControl moteus_control = MoteusControl::kTorque;
  MoteusListen moteus_listen = MoteusListen::kPoll;
  double theta_e_offset = 0;  // rad
  bool without_watchdog = false;
  void fields(FieldVisitor& f);

  // True if the drive itself switches off when the host is silent.
  bool device_has_watchdog() const;
  // True if the bridge can send commands to the drive: not to a VESC, nor over the debug UART of a
  // moteus.
  bool takes_commands() const;
  // True if the samples contain a voltage, without which no filter of the set can follow the drive.
  bool tells_voltage() const;
  // Time of a sample and a command on a serial line, 10 bits a byte: the longer of the two (they
  // pass each other). 0 on UDP.
  double wire_time_s() const;
};

}  // namespace twinrate

// Lines of mjbots' fdcanusb and the register frames of a moteus in them.
//
//   host    can send 8001 0b00..   ID = source << 8 | destination, 0x8000 asks for a reply
//   drive   OK                     the line was sent
//           rcv 100 2c..  E B F    the reply; flags that are not known are ignored
//
// A frame is a list of subframes: write 0x00, read 0x10, reply 0x20; + 0, 4, 8, 12 for int8, int16,
// int32, float; + the count of registers in the low two bits, or 0 and the count as a varuint; then
// the first register as a varuint. 0x50 pads. Source: mjbots/moteus, docs/reference.md.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace twinrate {

enum MoteusRegister : int {
  kMoteusMode = 0x00,
  kMoteusPosition = 0x01,  // turns
  kMoteusVelocity = 0x02,  // turns/s
  kMoteusTorque = 0x03,    // Nm
  kMoteusQCurrent = 0x04,  // A
  kMoteusDCurrent = 0x05,
  kMoteusVoltage = 0x0d,  // of the bus
  kMoteusFault = 0x0f,
  kMoteusPhaseA = 0x14,  // V, and 0x15, 0x16
  kMoteusFocAngle = 0x18,
  kMoteusCommandDVoltage = 0x1a,
  kMoteusCommandQVoltage = 0x1b,
  kMoteusCommandPosition = 0x20,
  kMoteusCommandVelocity = 0x21,
  kMoteusCommandTorque = 0x22,
  kMoteusKpScale = 0x23,
  kMoteusKdScale = 0x24,
  kMoteusMaxTorque = 0x25,
  kMoteusTimeout = 0x27,  // s
  kMoteusMillisecond = 0x70,
};
inline constexpr int kMoteusStopped = 0, kMoteusModeFault = 1, kMoteusModeVoltageDq = 8,
                     kMoteusModePosition = 10, kMoteusModeTimeout = 11, kMoteusModeStayWithin = 13;

struct MoteusFrame {
  std::map<int, double> writes, replies;  // by register
  std::vector<int> reads;                 // answered as float
  bool bad = false;                       // cut short, or an unknown subframe
};

// Registers of equal meaning are read as floats: `first` and `count`.
void put_moteus_read(std::vector<std::uint8_t>& frame, int first, int count);
void put_moteus_write(std::vector<std::uint8_t>& frame, int first, std::span<const float> values);
void put_moteus_write_int8(std::vector<std::uint8_t>& frame, int first, int value);
void put_moteus_reply(std::vector<std::uint8_t>& frame, int first, std::span<const float> values);
// To a length that CAN FD has.
void pad_moteus(std::vector<std::uint8_t>& frame);
MoteusFrame parse_moteus(std::span<const std::uint8_t> bytes);

struct CanLine {
  int id = 0;
  std::vector<std::uint8_t> bytes;
};
// "can send ID HEX" and "rcv ID HEX FLAGS"; empty for any other line.
std::optional<CanLine> parse_can_line(std::string_view line, std::string_view verb);
std::string can_line(std::string_view verb, int id, std::span<const std::uint8_t> bytes);

}  // namespace twinrate

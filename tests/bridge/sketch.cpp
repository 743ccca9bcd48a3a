#include "tests/bridge/sketch.hpp"

#include <math.h>
#include <stddef.h>
#include <stdint.h>

namespace twinrate::sketch {

Board board;

// In this namespace: the sketch compiles the protocol with float numbers.
#include "firmware/examples/simplefoc.ino"

SketchSerial Serial;
int SketchSerial::available() {
  return static_cast<int>(board.in.size());
}
int SketchSerial::read() {
  const int byte = board.in.front();
  board.in.pop_front();
  return byte;
}
void SketchSerial::write(const uint8_t* bytes, size_t size) {
  board.out.insert(board.out.end(), bytes, bytes + size);
}
uint32_t micros() {
  return board.us;
}
void BLDCDriver3PWM::enable() {
  board.enabled = true;
}
void BLDCDriver3PWM::disable() {
  board.enabled = false;
}
void BLDCDriver3PWM::setPwm(float a, float b, float c) {
  board.pwm[0] = a, board.pwm[1] = b, board.pwm[2] = c;
}
PhaseCurrent_s InlineCurrentSense::getPhaseCurrents() {
  return {board.i[0], board.i[1], board.i[2]};
}

}  // namespace twinrate::sketch

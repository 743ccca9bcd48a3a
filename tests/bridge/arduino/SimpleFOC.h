// What firmware/examples/simplefoc.ino uses of Arduino and SimpleFOC, on this machine.
#pragma once
struct SketchSerial {
  void begin(long) {}
  int available();
  int read();
  void write(const uint8_t* bytes, size_t size);
};
extern SketchSerial Serial;
uint32_t micros();
constexpr int A0 = 0, A2 = 2, AS5147_SPI = 0;

struct BLDCDriver3PWM {
  BLDCDriver3PWM(int, int, int, int) {}
  void init() {}
  void enable();
  void disable();
  void setPwm(float a, float b, float c);
  float voltage_power_supply = 0;
};
struct PhaseCurrent_s {
  float a, b, c;
};
struct InlineCurrentSense {
  InlineCurrentSense(float, float, int, int) {}
  void linkDriver(BLDCDriver3PWM*) {}
  void init() {}
  PhaseCurrent_s getPhaseCurrents();
};
struct MagneticSensorSPI {
  MagneticSensorSPI(int, int) {}
  void init() {}
  void update() {}
  float getAngle() { return 0.5f; }
};

// Example: a SimpleFOC-class board (STM32, ESP32, Teensy) as a drive of twinrate-bridge.
//
// The board samples currents and applies the voltage vector of the host; SimpleFOC drives inverter,
// current sense and sensor. Copy firmware/protocol/twinrate_protocol.h beside this sketch. Not tried
// on a board: adapt pins, driver and sense to yours, and test with the motor unloaded and a current
// limit on the supply.
//
// Safe by itself: the outputs go off when the lease of the host ends, on over-current, and stay off
// until CLEAR names the reason.
#define TWP_NUMBER float
#include <SimpleFOC.h>

#include "twinrate_protocol.h"

static const float kRate_Hz = 1000;  // rates.f_s_Hz of the drive file; USB serial closes no faster loop
static const uint32_t kLeaseMax_us = 20000;
static const float kTrip_A = 3, kBus_V = 24;
// Codes of docs/reason-codes.md.
static const uint16_t kCommandLost = 20, kOverCurrent = 72;

BLDCDriver3PWM driver(9, 5, 6, 8);
InlineCurrentSense sense(0.01f, 50.0f, A0, A2);
MagneticSensorSPI sensor(AS5147_SPI, 10);

static struct twp_receiver receiver;
static struct twp_lease lease;
static uint32_t tick = 0, started_us = 0, command_seq = 0;
static uint16_t bad_frames = 0, latched = 0;
static float u_alpha = 0, u_beta = 0;    // commanded
static float on_alpha = 0, on_beta = 0;  // applied since the last tick

static uint32_t now_us() { return micros() - started_us; }

static void outputs_off(uint16_t reason) {
  u_alpha = u_beta = on_alpha = on_beta = 0;
  lease.held = 0;
  driver.disable();
  if (reason != 0 && latched == 0) latched = reason;
}

static void send(struct twp_frame* f) {
  uint8_t wire[TWP_MAX_WIRE];
  f->header.time_us = now_us();
  Serial.write(wire, twp_write(f, wire));
}

static void send_info(uint32_t question) {
  struct twp_frame f = {};
  f.header.type = TWP_INFO;
  f.header.seq = question;
  f.body.info.f_s_Hz = kRate_Hz;
  f.body.info.lease_max_us = kLeaseMax_us;
  f.body.info.abilities = TWP_WATCHDOG | TWP_CAN_VOLTAGE;
  f.body.info.bad_frames = bad_frames;
  f.body.info.reason = latched;
  const char name[] = "simplefoc";
  for (size_t i = 0; i < sizeof name - 1; ++i) f.body.info.name[i] = name[i];
  send(&f);
}

static void take_command(const struct twp_frame* f) {
  const struct twp_command* c = &f->body.command;
  if (twp_difference(f->header.seq, command_seq) <= 0) return;  // doubled or late
  command_seq = f->header.seq;
  if (twp_difference(c->sample_seq, tick) > 0) return;  // of the time before a restart
  if (c->enable == 0) {
    outputs_off(0);
  } else if (latched == 0 && c->kind == TWP_COMMAND_VOLTAGE) {
    if (!lease.held) driver.enable();
    twp_lease_take(&lease, now_us(), c->lease_us, kLeaseMax_us);
    u_alpha = c->u_alphabeta[0];
    u_beta = c->u_alphabeta[1];
  }
}

static void take(const struct twp_frame* f) {
  if (f->header.type == TWP_HELLO) {
    command_seq = f->header.seq;
    send_info(f->header.seq);
  } else if (f->header.type == TWP_COMMAND) {
    take_command(f);
  } else if (f->header.type == TWP_CLEAR) {
    if (f->body.clear.reason == latched) latched = 0;
    send_info(f->header.seq);
  }
}

static void receive() {
  struct twp_frame f;
  while (Serial.available() > 0) {
    const enum twp_result result = twp_receive(&receiver, (uint8_t)Serial.read(), &f);
    if (result < 0) ++bad_frames;
    if (result == TWP_FRAME) take(&f);
  }
}

// Means over the next interval, centred on half the bus.
static void apply() {
  on_alpha = u_alpha;
  on_beta = u_beta;
  const float half = 0.5f * kBus_V;
  driver.setPwm(half + u_alpha, half - 0.5f * u_alpha + 0.8660254f * u_beta,
                half - 0.5f * u_alpha - 0.8660254f * u_beta);
}

static void send_sample(float i_a, float i_b, float i_c) {
  struct twp_frame f = {};
  f.header.type = TWP_SAMPLE;
  f.header.flags = TWP_CURRENTS | TWP_VOLTAGE | TWP_BUS | TWP_ANGLE;
  f.header.seq = tick;
  struct twp_sample* s = &f.body.sample;
  s->command_seq = command_seq;
  s->signals = 1 | 2 | 8;  // the bus voltage is set, not measured
  s->reason = latched;
  s->state = latched ? TWP_SAFE : lease.held ? TWP_RUN : TWP_IDLE;
  s->bad_frames = bad_frames;
  s->i_abc[0] = i_a;
  s->i_abc[1] = i_b;
  s->i_abc[2] = i_c;
  s->u_alphabeta[0] = on_alpha;
  s->u_alphabeta[1] = on_beta;
  s->v_dc = kBus_V;
  s->theta_m = sensor.getAngle();
  send(&f);
}

void setup() {
  Serial.begin(3000000);
  sensor.init();
  driver.voltage_power_supply = kBus_V;
  driver.init();
  driver.disable();
  sense.linkDriver(&driver);
  sense.init();
  started_us = micros();
}

void loop() {
  static uint32_t due_us = 0;
  receive();
  if (twp_difference(now_us(), due_us) < 0) return;
  due_us += (uint32_t)(1e6f / kRate_Hz);
  ++tick;
  sensor.update();
  const PhaseCurrent_s i = sense.getPhaseCurrents();
  send_sample(i.a, i.b, i.c);
  if (fabsf(i.a) > kTrip_A || fabsf(i.b) > kTrip_A || fabsf(i.c) > kTrip_A)
    outputs_off(kOverCurrent);
  if (twp_lease_ended(&lease, now_us())) outputs_off(kCommandLost);
  if (lease.held) apply();
}

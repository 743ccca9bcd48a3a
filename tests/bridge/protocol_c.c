/* The protocol header as a device compiles it: C99, freestanding, float numbers. */
#define TWP_NUMBER float
#include "tests/bridge/protocol_c.h"

#include "firmware/protocol/twinrate_protocol.h"

size_t device_sample(unsigned seq, unsigned time_us, float i_a, uint8_t* wire) {
  struct twp_frame f = {{0}, {{0}}};
  f.header.type = TWP_SAMPLE;
  f.header.flags = TWP_CURRENTS | TWP_BUS;
  f.header.seq = seq;
  f.header.time_us = time_us;
  f.body.sample.i_abc[0] = i_a;
  f.body.sample.v_dc = 24;
  return twp_write(&f, wire);
}

float device_u_alpha(const uint8_t* wire, size_t size) {
  struct twp_receiver r = {{0}, 0, 0, 0};
  struct twp_frame f;
  size_t i;
  float u_alpha = 0;
  for (i = 0; i < size; ++i)
    if (twp_receive(&r, wire[i], &f) == TWP_FRAME && f.header.type == TWP_COMMAND)
      u_alpha = f.body.command.u_alphabeta[0];
  return u_alpha;
}

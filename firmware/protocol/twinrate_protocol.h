/* The Twinrate protocol: framed samples and commands between a drive and a host.
 *
 *   device -> host   SAMPLE   currents, bus voltage, voltage applied, angle, state, reason code
 *                    INFO     the answer to HELLO: name, control rate, abilities, counts
 *   host -> device   COMMAND  voltage vector or duties, enable with a lease
 *                    HELLO    asks for INFO
 *                    CLEAR    leaves the latched off state, names the reason that it clears
 *
 * On the wire: COBS(frame, CRC-32 of the frame), then one zero byte. Little-endian. The layout of
 * each frame is in docs/bridge-protocol.md.
 *
 * Freestanding C99 and C++: no heap, no libc, no global state. Numbers travel as float32 or
 * float64; define TWP_NUMBER as float on a device without a double unit.
 */
#ifndef TWINRATE_PROTOCOL_H
#define TWINRATE_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

#ifndef TWP_NUMBER
#define TWP_NUMBER double
#endif

#define TWP_VERSION 1
#define TWP_HEADER_BYTES 12
#define TWP_MAX_FRAME 128 /* header, payload and CRC: the largest is a SAMPLE of float64 */
#define TWP_MAX_WIRE 130  /* with the code byte of COBS and the zero at the end */
#define TWP_NAME_BYTES 16

#ifdef __cplusplus
extern "C" {
#endif

enum twp_type { TWP_SAMPLE = 1, TWP_COMMAND = 2, TWP_HELLO = 3, TWP_INFO = 4, TWP_CLEAR = 5 };

/* Flags of a frame. A SAMPLE names the groups of numbers that it holds, in this order. */
enum twp_flag {
  TWP_FLOAT64 = 1,
  TWP_CURRENTS = 2,      /* i_a, i_b, i_c, A */
  TWP_VOLTAGE = 4,       /* u_alpha, u_beta: mean applied over the interval that ends here, V */
  TWP_DUTIES = 8,        /* duty_a, duty_b, duty_c, 0 .. 1 */
  TWP_BUS = 16,          /* v_dc, V */
  TWP_ANGLE = 32,        /* theta_m, mechanical, rad */
  TWP_SPEED = 64,        /* omega_m, mechanical, rad/s */
  TWP_FORCED_ANGLE = 128 /* electrical angle of the forced vector, rad */
};
#define TWP_ALL_GROUPS 254

/* State of the drive, as in safety/state_machine.hpp. */
enum twp_state { TWP_IDLE = 0, TWP_ALIGN = 1, TWP_RUN = 2, TWP_DERATE = 3, TWP_SAFE = 4 };

enum twp_command_kind { TWP_COMMAND_VOLTAGE = 0, TWP_COMMAND_DUTIES = 1 };

/* Abilities of a device, in INFO. HELLO asks for TWP_LOCKSTEP: the device waits for each command. */
enum twp_ability {
  TWP_CAN_FLOAT64 = 1,
  TWP_LOCKSTEP = 2,
  TWP_WATCHDOG = 4, /* the device itself ends the lease */
  TWP_CAN_VOLTAGE = 8,
  TWP_CAN_DUTIES = 16
};

struct twp_header {
  uint8_t version, type;
  uint16_t flags;
  uint32_t seq;     /* SAMPLE: control tick k; else a count of frames. Modulo 2^32 */
  uint32_t time_us; /* device time; COMMAND: that of the sample which it answers. Modulo 2^32 */
};

struct twp_sample {
  uint32_t command_seq; /* of the last command taken; 0: none */
  uint16_t signals;     /* bits of Signal in model/signals.hpp: fields that a sensor delivered */
  uint16_t reason;      /* code of core/reason.hpp while the state is TWP_SAFE, else 0 */
  uint8_t state, mode;  /* mode: that of the command applied */
  uint16_t bad_frames;  /* refused by the device so far, modulo 2^16 */
  TWP_NUMBER i_abc[3], u_alphabeta[2], duty_abc[3], v_dc, theta_m, omega_m, theta_forced;
};

struct twp_command {
  uint32_t sample_seq; /* tick of the sample that it answers */
  uint32_t lease_us;   /* how long after its arrival the device may drive; the device has a limit */
  uint8_t enable, mode;
  uint16_t kind; /* enum twp_command_kind */
  TWP_NUMBER u_alphabeta[2], duty_abc[3], theta_ctrl;
};

struct twp_hello {
  uint16_t abilities; /* asked for */
};

struct twp_info {
  double f_s_Hz;
  uint32_t lease_max_us;
  uint16_t abilities, bad_frames, lost_frames; /* commands: refused; missing in the sequence */
  uint16_t reason;                             /* latched, or 0 */
  char name[TWP_NAME_BYTES];                   /* padded with zeros */
};

struct twp_clear {
  uint16_t reason; /* must be the latched one */
};

struct twp_frame {
  struct twp_header header;
  union {
    struct twp_sample sample;
    struct twp_command command;
    struct twp_hello hello;
    struct twp_info info;
    struct twp_clear clear;
  } body;
};

/* a - b on a circle of 2^32: sequence numbers and microseconds. Valid below half the circle,
 * 35.8 minutes. */
static inline int32_t twp_difference(uint32_t a, uint32_t b) {
  const uint32_t d = a - b;
  return d < 0x80000000u ? (int32_t)d : -(int32_t)(0xffffffffu - d) - 1;
}

/* ---- CRC-32 of zlib: polynomial 0x04c11db7 reflected, start and end inverted ---- */

static const uint32_t twp_crc_table[16] = {0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu,
                                           0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
                                           0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
                                           0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};

static inline uint32_t twp_crc32(const uint8_t* bytes, size_t size) {
  uint32_t crc = 0xffffffffu;
  size_t i;
  for (i = 0; i < size; ++i) {
    crc ^= bytes[i];
    crc = twp_crc_table[crc & 15u] ^ (crc >> 4);
    crc = twp_crc_table[crc & 15u] ^ (crc >> 4);
  }
  return ~crc;
}

/* ---- COBS: no zero inside a frame ---- */

/* Of size + 1 + size/254 bytes at most; without the zero at the end. */
static inline size_t twp_cobs_encode(const uint8_t* in, size_t size, uint8_t* out) {
  size_t code_at = 0, to = 1, i;
  uint8_t code = 1;
  for (i = 0; i < size; ++i) {
    if (in[i] != 0) {
      out[to++] = in[i];
      ++code;
    }
    if (in[i] == 0 || (code == 255 && i + 1 < size)) {
      out[code_at] = code;
      code_at = to++;
      code = 1;
    }
  }
  out[code_at] = code;
  return to;
}

/* Size of the frame, at most size - 1; 0 where the bytes are no COBS. In place is allowed. */
static inline size_t twp_cobs_decode(const uint8_t* in, size_t size, uint8_t* out) {
  size_t from = 0, to = 0;
  while (from < size) {
    const uint8_t code = in[from++];
    uint8_t i;
    if (code == 0 || from + code - 1 > size) return 0;
    for (i = 1; i < code; ++i) {
      if (in[from] == 0) return 0;
      out[to++] = in[from++];
    }
    if (code < 255 && from < size) out[to++] = 0;
  }
  return to;
}

/* ---- Fields ---- */

struct twp_writer {
  uint8_t* to;
  int float64;
};
struct twp_reader {
  const uint8_t *from, *end;
  int float64, is_short;
};

static inline void twp_put(struct twp_writer* w, uint64_t bits, int bytes) {
  for (; bytes > 0; --bytes, bits >>= 8) *w->to++ = (uint8_t)(bits & 255u);
}
static inline uint64_t twp_get(struct twp_reader* r, int bytes) {
  uint64_t bits = 0;
  int i;
  if (r->end - r->from < bytes) {
    r->is_short = 1;
    return 0;
  }
  for (i = 0; i < bytes; ++i) bits |= (uint64_t)*r->from++ << (8 * i);
  return bits;
}

/* A union changes the type of the bits in C; GCC and clang keep that in C++. */
static inline void twp_put_double(struct twp_writer* w, double x) {
  union {
    double x;
    uint64_t bits;
  } both;
  both.x = x;
  twp_put(w, both.bits, 8);
}
static inline double twp_get_double(struct twp_reader* r) {
  union {
    double x;
    uint64_t bits;
  } both;
  both.bits = twp_get(r, 8);
  return both.x;
}
static inline void twp_put_numbers(struct twp_writer* w, const TWP_NUMBER* x, int count) {
  union {
    float x;
    uint32_t bits;
  } both;
  int i;
  for (i = 0; i < count; ++i) {
    if (w->float64) {
      twp_put_double(w, (double)x[i]);
    } else {
      both.x = (float)x[i];
      twp_put(w, both.bits, 4);
    }
  }
}
static inline void twp_get_numbers(struct twp_reader* r, TWP_NUMBER* x, int count) {
  union {
    float x;
    uint32_t bits;
  } both;
  int i;
  for (i = 0; i < count; ++i) {
    if (r->float64) {
      x[i] = (TWP_NUMBER)twp_get_double(r);
    } else {
      both.bits = (uint32_t)twp_get(r, 4);
      x[i] = (TWP_NUMBER)both.x;
    }
  }
}

/* ---- Bodies ---- */

static inline void twp_put_sample(struct twp_writer* w, uint16_t flags,
                                  const struct twp_sample* s) {
  twp_put(w, s->command_seq, 4);
  twp_put(w, s->signals, 2);
  twp_put(w, s->reason, 2);
  twp_put(w, s->state, 1);
  twp_put(w, s->mode, 1);
  twp_put(w, s->bad_frames, 2);
  if (flags & TWP_CURRENTS) twp_put_numbers(w, s->i_abc, 3);
  if (flags & TWP_VOLTAGE) twp_put_numbers(w, s->u_alphabeta, 2);
  if (flags & TWP_DUTIES) twp_put_numbers(w, s->duty_abc, 3);
  if (flags & TWP_BUS) twp_put_numbers(w, &s->v_dc, 1);
  if (flags & TWP_ANGLE) twp_put_numbers(w, &s->theta_m, 1);
  if (flags & TWP_SPEED) twp_put_numbers(w, &s->omega_m, 1);
  if (flags & TWP_FORCED_ANGLE) twp_put_numbers(w, &s->theta_forced, 1);
}
/* Groups that are not there stay as they are. */
static inline void twp_get_sample(struct twp_reader* r, uint16_t flags, struct twp_sample* s) {
  s->command_seq = (uint32_t)twp_get(r, 4);
  s->signals = (uint16_t)twp_get(r, 2);
  s->reason = (uint16_t)twp_get(r, 2);
  s->state = (uint8_t)twp_get(r, 1);
  s->mode = (uint8_t)twp_get(r, 1);
  s->bad_frames = (uint16_t)twp_get(r, 2);
  if (flags & TWP_CURRENTS) twp_get_numbers(r, s->i_abc, 3);
  if (flags & TWP_VOLTAGE) twp_get_numbers(r, s->u_alphabeta, 2);
  if (flags & TWP_DUTIES) twp_get_numbers(r, s->duty_abc, 3);
  if (flags & TWP_BUS) twp_get_numbers(r, &s->v_dc, 1);
  if (flags & TWP_ANGLE) twp_get_numbers(r, &s->theta_m, 1);
  if (flags & TWP_SPEED) twp_get_numbers(r, &s->omega_m, 1);
  if (flags & TWP_FORCED_ANGLE) twp_get_numbers(r, &s->theta_forced, 1);
}

static inline void twp_put_command(struct twp_writer* w, const struct twp_command* c) {
  twp_put(w, c->sample_seq, 4);
  twp_put(w, c->lease_us, 4);
  twp_put(w, c->enable, 1);
  twp_put(w, c->mode, 1);
  twp_put(w, c->kind, 2);
  if (c->kind == TWP_COMMAND_DUTIES)
    twp_put_numbers(w, c->duty_abc, 3);
  else
    twp_put_numbers(w, c->u_alphabeta, 2);
  twp_put_numbers(w, &c->theta_ctrl, 1);
}
static inline void twp_get_command(struct twp_reader* r, struct twp_command* c) {
  c->sample_seq = (uint32_t)twp_get(r, 4);
  c->lease_us = (uint32_t)twp_get(r, 4);
  c->enable = (uint8_t)twp_get(r, 1);
  c->mode = (uint8_t)twp_get(r, 1);
  c->kind = (uint16_t)twp_get(r, 2);
  if (c->kind > TWP_COMMAND_DUTIES) r->is_short = 1; /* its length is unknown */
  if (c->kind == TWP_COMMAND_DUTIES)
    twp_get_numbers(r, c->duty_abc, 3);
  else
    twp_get_numbers(r, c->u_alphabeta, 2);
  twp_get_numbers(r, &c->theta_ctrl, 1);
}

static inline void twp_put_info(struct twp_writer* w, const struct twp_info* info) {
  int i;
  twp_put_double(w, info->f_s_Hz);
  twp_put(w, info->lease_max_us, 4);
  twp_put(w, info->abilities, 2);
  twp_put(w, info->bad_frames, 2);
  twp_put(w, info->lost_frames, 2);
  twp_put(w, info->reason, 2);
  for (i = 0; i < TWP_NAME_BYTES; ++i) twp_put(w, (uint8_t)info->name[i], 1);
}
static inline void twp_get_info(struct twp_reader* r, struct twp_info* info) {
  int i;
  info->f_s_Hz = twp_get_double(r);
  info->lease_max_us = (uint32_t)twp_get(r, 4);
  info->abilities = (uint16_t)twp_get(r, 2);
  info->bad_frames = (uint16_t)twp_get(r, 2);
  info->lost_frames = (uint16_t)twp_get(r, 2);
  info->reason = (uint16_t)twp_get(r, 2);
  for (i = 0; i < TWP_NAME_BYTES; ++i) info->name[i] = (char)twp_get(r, 1);
}

/* ---- Frames ---- */

/* Writes a whole frame with its zero into TWP_MAX_WIRE bytes; returns its size. The version is set
 * here. 0 where the type is unknown. */
static inline size_t twp_write(const struct twp_frame* f, uint8_t* wire) {
  uint8_t raw[TWP_MAX_FRAME];
  struct twp_writer w;
  size_t size;
  w.to = raw;
  w.float64 = (f->header.flags & TWP_FLOAT64) != 0;
  twp_put(&w, TWP_VERSION, 1);
  twp_put(&w, f->header.type, 1);
  twp_put(&w, f->header.flags, 2);
  twp_put(&w, f->header.seq, 4);
  twp_put(&w, f->header.time_us, 4);
  switch (f->header.type) {
    case TWP_SAMPLE:
      twp_put_sample(&w, f->header.flags, &f->body.sample);
      break;
    case TWP_COMMAND:
      twp_put_command(&w, &f->body.command);
      break;
    case TWP_HELLO:
      twp_put(&w, f->body.hello.abilities, 2);
      break;
    case TWP_INFO:
      twp_put_info(&w, &f->body.info);
      break;
    case TWP_CLEAR:
      twp_put(&w, f->body.clear.reason, 2);
      break;
    default:
      return 0;
  }
  size = (size_t)(w.to - raw);
  twp_put(&w, twp_crc32(raw, size), 4);
  size = twp_cobs_encode(raw, size + 4, wire);
  wire[size] = 0;
  return size + 1;
}

enum twp_result {
  TWP_NOTHING = 0,     /* the frame goes on */
  TWP_FRAME = 1,       /* a whole frame */
  TWP_BAD_COBS = -1,   /* no COBS, or longer than any frame */
  TWP_BAD_CRC = -2,    /* bits changed, bytes missing */
  TWP_BAD_VERSION = -3 /* whole, but of another version, type or length */
};

/* Reads the bytes between two zeros. */
static inline enum twp_result twp_read(const uint8_t* wire, size_t size, struct twp_frame* f) {
  uint8_t raw[TWP_MAX_WIRE];
  struct twp_reader r;
  size_t n, i;
  uint32_t crc = 0;
  if (size == 0 || size >= TWP_MAX_WIRE) return TWP_BAD_COBS;
  n = twp_cobs_decode(wire, size, raw);
  if (n < TWP_HEADER_BYTES + 4) return TWP_BAD_COBS;
  for (i = 0; i < 4; ++i) crc |= (uint32_t)raw[n - 4 + i] << (8 * i);
  if (crc != twp_crc32(raw, n - 4)) return TWP_BAD_CRC;
  r.from = raw;
  r.end = raw + n - 4;
  r.is_short = 0;
  f->header.version = (uint8_t)twp_get(&r, 1);
  f->header.type = (uint8_t)twp_get(&r, 1);
  f->header.flags = (uint16_t)twp_get(&r, 2);
  f->header.seq = (uint32_t)twp_get(&r, 4);
  f->header.time_us = (uint32_t)twp_get(&r, 4);
  r.float64 = (f->header.flags & TWP_FLOAT64) != 0;
  if (f->header.version != TWP_VERSION) return TWP_BAD_VERSION;
  switch (f->header.type) {
    case TWP_SAMPLE:
      twp_get_sample(&r, f->header.flags, &f->body.sample);
      break;
    case TWP_COMMAND:
      twp_get_command(&r, &f->body.command);
      break;
    case TWP_HELLO:
      f->body.hello.abilities = (uint16_t)twp_get(&r, 2);
      break;
    case TWP_INFO:
      twp_get_info(&r, &f->body.info);
      break;
    case TWP_CLEAR:
      f->body.clear.reason = (uint16_t)twp_get(&r, 2);
      break;
    default:
      return TWP_BAD_VERSION;
  }
  return r.is_short || r.from != r.end ? TWP_BAD_VERSION : TWP_FRAME;
}

/* Bytes in, frames out. Zero it before use. The first bytes after a start may be the end of a frame:
 * what comes before the first zero is not counted as bad. */
struct twp_receiver {
  uint8_t wire[TWP_MAX_WIRE];
  uint16_t size;
  uint8_t too_long, begun;
};

static inline enum twp_result twp_receive(struct twp_receiver* r, uint8_t byte,
                                          struct twp_frame* f) {
  enum twp_result result;
  if (byte != 0) {
    if (r->size < TWP_MAX_WIRE)
      r->wire[r->size++] = byte;
    else
      r->too_long = 1;
    return TWP_NOTHING;
  }
  result = r->size == 0 ? TWP_NOTHING : r->too_long ? TWP_BAD_COBS : twp_read(r->wire, r->size, f);
  if (result < 0 && !r->begun) result = TWP_NOTHING;
  r->begun = 1;
  r->size = 0;
  r->too_long = 0;
  return result;
}

/* ---- The lease: a device drives until its end, and no longer ---- */

struct twp_lease {
  uint32_t end_us;
  uint8_t held;
};
/* A command that enables has arrived. The lease is the shorter of the two. */
static inline void twp_lease_take(struct twp_lease* l, uint32_t now_us, uint32_t lease_us,
                                  uint32_t lease_max_us) {
  l->end_us = now_us + (lease_us < lease_max_us ? lease_us : lease_max_us);
  l->held = 1;
}
/* Once every control tick. 1 where the lease has just ended: outputs off, latched. */
static inline int twp_lease_ended(struct twp_lease* l, uint32_t now_us) {
  if (!l->held || twp_difference(now_us, l->end_us) < 0) return 0;
  l->held = 0;
  return 1;
}

#ifdef __cplusplus
}
#endif
#endif

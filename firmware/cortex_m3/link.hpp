// The frames between the host and the Cortex-M3 in the loop.
//
//   host -> processor   Start as raw bytes with its CRC-32; then one SAMPLE of the protocol a tick
//                       (currents and voltage, float32); a CLEAR asks for the answer alone, without a
//                       tick; a HELLO ends the run
//   processor -> host   Answer, followed by a NewGain if Start asks for gains and the background has
//                       finished one since the last answer: words, little-endian, CRC-32, COBS and a
//                       zero, like the protocol frames
//
// The seq of a SAMPLE is its tick.
#pragma once
#include "firmware/cortex_m3/two_rate.hpp"
#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate::m3 {

struct Start {
  Settings settings;
  uint32_t systick_reload;  // control period less one, in cycles of 40 ns
  uint32_t sends_gains;
};

struct Answer {
  uint32_t k;
  int32_t i_alpha, i_beta, omega;
  uint32_t theta;
  int32_t gain_snapshot;
  uint32_t preempted;  // ticks that interrupted the background
  uint32_t progress;   // hash of the addresses at which the background was interrupted
  uint32_t late, bad_frames;
  uint32_t clamped_P33, clamped_P34, clamped_P44, clamped_omega;
};
// The result of the background for snapshot k, raw.
struct NewGain {
  int32_t k;
  uint32_t theta;
  int32_t K[8];   // row-major 4 by 2, kK of the format
  int32_t P[10];  // upper triangle row by row, kP
};
inline constexpr size_t kAnswerWire = sizeof(Answer) + sizeof(NewGain) + 4 + 2;

// `gain`: null for none.
inline size_t write_answer(const Answer& answer, const NewGain* gain, uint8_t* wire) {
  uint8_t raw[sizeof(Answer) + sizeof(NewGain) + 4];
  size_t size = sizeof answer;
  __builtin_memcpy(raw, &answer, sizeof answer);
  if (gain) {
    __builtin_memcpy(raw + size, gain, sizeof *gain);
    size += sizeof *gain;
  }
  const uint32_t crc = twp_crc32(raw, size);
  __builtin_memcpy(raw + size, &crc, 4);
  size = twp_cobs_encode(raw, size + 4, wire);
  wire[size] = 0;
  return size + 1;
}

// `wire`: the bytes before the zero. `gain.k` is -1 if the answer has no gain.
inline bool read_answer(const uint8_t* wire, size_t size, Answer& answer, NewGain& gain) {
  uint8_t raw[kAnswerWire];
  if (size >= kAnswerWire) return false;
  const size_t read = twp_cobs_decode(wire, size, raw), alone = sizeof(Answer) + 4;
  if (read != alone && read != alone + sizeof(NewGain)) return false;
  uint32_t crc;
  __builtin_memcpy(&crc, raw + read - 4, 4);
  if (crc != twp_crc32(raw, read - 4)) return false;
  __builtin_memcpy(&answer, raw, sizeof answer);
  gain.k = -1;
  if (read != alone) __builtin_memcpy(&gain, raw + sizeof answer, sizeof gain);
  return true;
}

}  // namespace twinrate::m3

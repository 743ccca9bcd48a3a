// The example sketch of firmware/examples on this machine: a board whose pins are the members here.
#pragma once
#include <cstdint>
#include <deque>
#include <vector>

namespace twinrate::sketch {

struct Board {
  std::uint32_t us = 0;
  std::deque<std::uint8_t> in;
  std::vector<std::uint8_t> out;
  float i[3] = {};
  bool enabled = false;
  float pwm[3] = {};
};
extern Board board;
void setup();
void loop();

}  // namespace twinrate::sketch

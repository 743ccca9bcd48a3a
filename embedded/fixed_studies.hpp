// Studies of the fixed-point filter on this machine.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// f_bmin of the fixed-point filter and of the double-precision one at one speed, start from
// standstill at 16000 rad/s2, as in `sweep fb`: n rises from 1 to the first loss with any seed.
struct LimitStudy {
  std::string policy = "paper";
  bool switched = false;  // n = 1 until the drive has been at speed for 0.2 s
  int seeds = 5, n_max = 200;
};
struct LimitPair {
  double f_e_Hz = 0;
  int n_max_fixed = 0, n_max_double = 0;
};
LimitPair find_limits(const std::string& drive, const LimitStudy& study, double f_e_Hz);

// A run at standstill for `hours` with every operation checked. Throws m3::Wrapped at the first
// wrap.
std::string standstill(const std::string& drive, double hours);

}  // namespace twinrate

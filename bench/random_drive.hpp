// Drives drawn at random, for bench/pairings: machine, bus, rates, sensors, profile, and which filter,
// controller, policy, start and n. The quantities that a motor's maker is free in are drawn; the
// others follow, so that each drive can run its own profile:
//
//   n_p 2 to 21, L_q 0.05 to 20 mH, f_s 5 to 20 kHz, v_dc 12 to 600 V          (log) uniform
//   L_d/L_q          1 in every second drive, else 0.4 to 1
//   rated frequency  f_s/400 to f_s/25: 25 to 400 samples an electrical turn
//   psi_f            EMF at rated speed 0.5 to 0.75 of v_dc/sqrt3
//   rated current    omega_e L_q i from 0.05 to 0.6 of that EMF
//   R_s              R_s i from 0.02 to 0.2 of it
//   J                t_m = J omega_m/T_rated from 20 to 500 ms;  B takes 0.1 to 1 % of T_rated
//   noise            0.5 % of the rated current a phase; encoder of 4096 to 2^20 counts
//   profile          0.2 to 1 of rated speed in 0.5 s, load 0 to 0.8 of rated from 1.2 s on
#pragma once
#include <cstdint>
#include <string>

namespace twinrate::bench {

struct RandomDrive {
  std::string text;  // a drive file
  std::string estimator, controller, start, policy;
  int n = 1;
  std::string machine;  // one line
};

RandomDrive draw_drive(std::uint64_t seed, std::uint64_t index);

}  // namespace twinrate::bench

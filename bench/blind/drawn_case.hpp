// A drawn machine, its profile, the columns of its log, and the effects that its drive file lacks.
//
// Profiles:
//   rich           speeds and known loads of both signs, i_d
//   slow           2 to 6 % of rated speed
//   one_direction  speeds of one sign, half of the logs with known loads
//   one_start      one start, then one speed
//   p2p            repetitions of one point-to-point move
//   steady         one speed from the first row on
// Modes:
//   full           every tick
//   decimated      samples of single ticks at 2000, 1000, 500 or 200 Hz
//   angle_current  t, theta_m and i_q at one of these rates, without load and i_d
//   novolt         phase currents and angle, any rate
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_hidden.hpp"
#include "model/profile.hpp"

namespace twinrate::blind {

struct DrawnCase {
  std::string name;
  std::uint64_t seed = 0;
  int attempt = 0;
  DrawnMachine drawn;
  std::string profile, mode;
  int every = 1;              // ticks from row to row
  bool mean_voltage = false;  // true: mean in stator axes up to the next row; false: of the tick
  bool with_load = false;     // column T_load
  double slew_rad_s2 = 0;     // of the speed reference
  Profile speed_rad_s, load_Nm, i_d_A;
  std::vector<std::string> kinds;          // true effects
  std::vector<std::string> effect_tables;  // one [[effect]] table each
  std::string effects_toml;                // all of them
  HiddenEffect hidden;                     // besides them, outside the catalogue
  double duration_s = 6;
};

// Half of the cases have no effect, the others one to three. Their sizes are 3 to 20 times
// (torques: 5 to 60 times) the smallest size worth reporting. `attempt`: number of the draw with
// the same seed.
DrawnCase draw_case(std::uint64_t seed, int attempt = 0);
// Slew rate of the declared load, Nm/s.
double load_slew(const DrawnCase& which);
// The drive file of the plant.
std::string plant_toml(const DrawnCase& which);

}  // namespace twinrate::blind

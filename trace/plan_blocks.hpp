// Building blocks of a measurement: half a second to three seconds of references for a lab bench.
//
// Every block begins and ends at rest, without load and i_d, so that blocks may follow one another
// in any order. References are steps. The speed's ramps come from the slew limit; slow ramps are
// staircases.
#pragma once
#include <string>
#include <vector>

#include "core/drive_config.hpp"

namespace twinrate {

// Limits of the bench. Motor speeds, peak currents.
struct Bench {
  double omega_m_max = 0;  // rad/s
  double i_max = 0;        // A, amplitude
  double T_load_max = 0;   // Nm; 0: no load machine
  double slew = 0;         // rad/s^2 of the mechanical speed
  double load_slew = 0;    // Nm/s
  bool reverse = true;     // the motor may run backwards
};

// From the drive file: rated speed and current, at most the speed that 80 % of the voltage and 0.5
// rad a sampling interval (electrical) allow, half the rated torque to accelerate, a load of at
// most 0.6 of it. Keys that the file lacks are derived from the others.
Bench bench_of(const DriveConfig& drive, double i_limit);

struct PlanBlock {
  std::string name, words;
  double duration_s = 0;
  std::vector<ProfileStep> omega_m, T_load, i_d;  // from 0 on, ascending, SI
};
std::vector<PlanBlock> building_blocks(const Bench& bench);

// Blocks in sequence.
struct PlanProfile {
  std::vector<ProfileStep> omega_m, T_load, i_d;
  std::vector<double> start_s;  // of each block
  double duration_s = 0;
};
PlanProfile assemble(const std::vector<PlanBlock>& blocks, const std::vector<std::size_t>& order);

}  // namespace twinrate

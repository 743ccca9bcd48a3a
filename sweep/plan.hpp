// What a sweep is asked for, and the searches it consists of.
//
// One search is (policy, speed, seed): n goes up from 1 until the first loss or the cap. Points are
// independent of each other, so a sweep splits over threads, processes and machines without
// changing a bit.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate::sweep {

struct Plan {
  std::string drive;
  std::vector<std::string> overrides;
  std::vector<double> speeds_Hz;
  std::vector<std::string> policies;
  int seeds = 5;
  std::string start = "ramp";  // or "switched": n = 1 at speed for 0.2 s, then n
  double ramp_rad_s2 = 16000;
  int n_max = 200;
  double load_pu = 0;
  std::string over = "inprocess";  // or "lcm"
  std::string engine =
      "lanes";      // in process: lanes/engine.hpp where it covers the drive; "reference"
  std::string log;  // a recorded drive instead of simulated ones
  int shard = 0, shards = 1;
};

struct Search {
  std::string policy;
  double f_e_Hz = 0;
  int seed = 1;
};

// Throws BadInput: an unknown policy, a speed out of range, no seeds.
void check(const Plan& plan);
std::vector<Search> searches(const Plan& plan);  // of every shard, in the order of the result
// "i/n", i from 0. Throws BadInput.
void set_shard(Plan& plan, const std::string& text);
// Rank and size of mpirun or srun, where one of them started this process.
bool set_shard_from_launcher(Plan& plan);

// The drive of one point: the plan's file with everything set that the point fixes.
std::vector<std::string> point_overrides(const Plan& plan, const DriveConfig& base,
                                         const Search& search, int n);
// Next n to try above `held`: every one up to 64, then steps of 5 %.
int next_n(int held);

// What results must have in common to be one sweep, as JSON text: everything but the shard.
std::string identity(const Plan& plan, const Config& config);
Plan plan_of(const std::string& sweep_json);

}  // namespace twinrate::sweep

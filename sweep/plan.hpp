// The request of a sweep and its searches.
//
// One search is (policy, speed, seed): n rises from 1 to the first loss of synchronism or to n_max.
// Points are independent: threads, processes and machines give equal results, bit for bit.
#pragma once
#include <cstdint>
#include <optional>
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
  std::string start = "ramp";  // or "switched": 0.2 s at speed with n = 1, then n
  double ramp_rad_s2 = 16000;
  int n_max = 200;
  std::optional<double> load_pu;   // empty: the load of the drive file
  std::string over = "inprocess";  // or "lcm"
  std::string engine = "lanes";  // in process: lanes/engine.hpp if it covers the drive; "reference"
  std::string log;               // a recorded drive instead of simulated ones
  int shard = 0, shards = 1;
  double start_takes_s = 0;  // loop/runnable.hpp, of the drive: the window comes later by it
};

struct Search {
  std::string policy;
  double f_e_Hz = 0;
  int seed = 1;
};

// Throws BadInput: an unknown policy, a speed out of range, no seeds.
void check(const Plan& plan);
std::vector<Search> searches(const Plan& plan);  // of all shards, in the order of the result
// "i/n", i from 0. Throws BadInput.
void set_shard(Plan& plan, const std::string& text);
// Takes rank and size of mpirun or srun; false if neither started this process.
bool set_shard_from_launcher(Plan& plan);

// Times of one point, s: the gain has its period of n ticks from n_from_s on.
struct PointTimes {
  double n_from_s = 0, settle_s = 0, duration_s = 0;
};
PointTimes point_times(const Plan& plan, const DriveConfig& base, double f_e_Hz, int n);
// The overrides of one point: those of the plan, and the keys that the point sets.
std::vector<std::string> point_overrides(const Plan& plan, const DriveConfig& base,
                                         const Search& search, int n);
// Next n above `held`: steps of 1 up to 64, then of 5 %.
int next_n(int held);

// `twinrate sweep fb ..` with the options of the plan, without its shard.
std::string command_of(const Plan& plan);

// The plan without its shard, as JSON text. Results of one sweep have the same identity.
std::string identity(const Plan& plan, const Config& config);
Plan plan_of(const std::string& sweep_json);

}  // namespace twinrate::sweep

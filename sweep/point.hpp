// One point of a sweep: does the drive keep synchronism at this speed with a gain every n ticks?
//
// The verdict is `locked` of summary.json (analysis/summary.hpp) over the window of the point.
#pragma once
#include <optional>
#include <span>

#include "core/run_log.hpp"
#include "lanes/points.hpp"
#include "sweep/plan.hpp"

namespace twinrate::sweep {

struct Point {
  Search search;
  double f_s_Hz = 0;
  int n = 1;
  bool locked = false;
  double angle_error_rms = 0, angle_error_max = 0;
};

// Throws the exceptions of the closed loop. If the integrator fails because the drive diverges, the
// point is lost.
Point run_in_process(const Plan& plan, const DriveConfig& base, const Search& search, int n);
// Searches of one policy and speed in the lane engine (lanes/engine.hpp): the drive of their points but
// for n, the times and the seed.
struct LaneDrive {
  lanes::LaneSettings settings;
  DriveConfig drive;
};
// Empty if the engine does not cover the drive. Throws BadInput.
std::optional<LaneDrive> lane_drive(const Plan& plan, const DriveConfig& base,
                                    const Search& search);
struct Task {
  Search search;
  int n = 1;
};
// The points of `tasks`, in their order.
std::vector<Point> run_in_lanes(const Plan& plan, const LaneDrive& lane_drive,
                                std::span<const Task> tasks, int threads);
// The same point with `twinrate launch`, five processes over LCM, in a temporary directory within
// `directory`.
Point run_over_lcm(const Plan& plan, const DriveConfig& base, const Search& search, int n,
                   const std::string& directory);
// Throws BadInput if the drive, with a gain every tick, keeps synchronism but turns more than 10 %
// slower or faster than a speed of the plan: a limit of n found there would not apply to that
// speed.
void expect_speeds_reached(const Plan& plan, const DriveConfig& base);
// The filter of plan.drive alone on the samples of a recorded drive, compared with its measured (or
// true) angle. Start and window are those of the recording, if its log has them. `plan.start`
// "switched": a gain every tick until 0.3 s before the window of the recording.
Point run_on_log(const RunLog& log, const Plan& plan, const Search& search, int n);
// Mean electrical frequency of a recorded drive over its window. Throws BadInput without a rotor
// angle in the log, or for a log of another f_s than that of plan.drive.
double recorded_f_e_Hz(const RunLog& log, const Plan& plan);

}  // namespace twinrate::sweep

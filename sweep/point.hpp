// One point of a sweep: is the drive held at this speed with a gain every n ticks?
//
// The verdict is `locked` of summary.json (analysis/summary.hpp): over the window of the point no angle
// error beyond pi/2 against the true rotor, and the true speed away from its reference by more than
// 20 % for less than 20 ms.
#pragma once
#include "core/run_log.hpp"
#include "sweep/plan.hpp"

namespace twinrate::sweep {

struct Point {
  Search search;
  double f_s_Hz = 0;
  int n = 1;
  bool locked = false;
  double angle_error_rms = 0, angle_error_max = 0;
};

// Throws what the drive throws; an integrator that fails because the drive ran away counts as lost.
Point run_in_process(const Plan& plan, const DriveConfig& base, const Search& search, int n);
// Several at once by the lane engine (lanes/engine.hpp); none where it does not cover the drive.
std::vector<Point> run_in_lanes(const Plan& plan, const DriveConfig& base, const Search& search,
                                const std::vector<int>& n);
// The same point through `twinrate launch`, five processes over LCM; leaves nothing behind.
Point run_over_lcm(const Plan& plan, const DriveConfig& base, const Search& search, int n,
                   const std::string& scratch);
// The filter alone on the samples of a recorded drive, against its measured (or true) angle.
// `plan.start` "switched": a gain every tick until 0.3 s before the recording's window.
Point run_on_log(const RunLog& log, const Plan& plan, const Search& search, int n);
// The steady electrical frequency of a recorded drive, over its window.
double recorded_f_e_Hz(const RunLog& log);

}  // namespace twinrate::sweep

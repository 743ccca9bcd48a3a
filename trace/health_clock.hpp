// The meaning of the time stamps of a log.
//
//   even    rows were sampled evenly, whatever their stamps are: the stamps stray around an even
//           grid, a long interval is followed by a short one, and the angle follows the row number
//   uneven  rows were sampled at their stamps: the angle follows the stamp. Without motion:
//           successive intervals are uncorrelated
//
// The slope of the angle's second difference over omega_m times the stamps' distinguishes the two:
// 0 or 1.
#pragma once
#include <optional>

#include "trace/health.hpp"

namespace twinrate {

// Maps rows onto an even grid. The grid follows the stamps slowly, so that a stray stamp neither
// adds nor removes a row.
class EvenGrid {
 public:
  // Steps of the grid since the row before; 0 for the first row.
  std::int64_t steps_to(double t, double T_s);

 private:
  std::optional<double> at_;  // s, time of the grid at the row before
  double rows_ = 0;           // that the grid has followed since the last gap
};

class ClockScan {
 public:
  void add(double t, const double* theta_m, double T_s);
  struct Stamps {
    bool stray = false;   // by more than a tolerance
    bool uneven = false;  // the rows are uneven, too
    double T_s = 0;       // even: of the grid; uneven: the mean interval
    double jitter = 0;  // even: of the stamps from the grid, rms over T_s; uneven: of the intervals
    std::size_t missing = 0;  // rows
  };
  Stamps result(double T_s) const;

 private:
  struct Row {
    double t, theta_m;
  };
  EvenGrid grid_;
  std::optional<Row> last_, before_;
  double first_t_ = 0;
  std::int64_t steps_ = 0;
  std::size_t rows_ = 0, missing_ = 0, gaps_ = 0;
  // Intervals that are no gaps: their number, those off the multiples of T_s, pairs; sums in T_s.
  std::size_t intervals_ = 0, off_ = 0, pairs_ = 0;
  double time_ = 0, time_squares_ = 0, squares_ = 0, products_ = 0, stray_squares_ = 0;
  double shortest_ = 0,
         longest_ = 1e300;  // s, interval of even rows within two intervals of all stamps
  // Second differences: of the angle, and of the stamps times omega_m.
  std::size_t turning_ = 0;
  double angle_squares_ = 0, stamp_squares_ = 0, both_ = 0;
};

// The rows of an uneven log at even times. Currents, angle and similar signals follow the cubic
// through four rows. The voltage, in stator axes, is the mean over each even interval. Gaps stay.
RawLog even_rows(const RawLog& raw, int n_p, double T_s);

}  // namespace twinrate

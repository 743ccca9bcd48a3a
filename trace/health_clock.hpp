// What the time stamps of a log are worth.
//
//   even    rows were sampled evenly, whatever their stamps say: those stray around an even grid, a
//           long interval is followed by a short one, and the angle goes by the row
//   uneven  rows were sampled when their stamps say: the angle goes by the stamp. Without motion:
//           intervals that follow each other have nothing to do with each other
//
// The slope of the angle's second difference over omega_m times the stamps' tells which: 0 or 1.
#pragma once
#include <optional>

#include "trace/health.hpp"

namespace twinrate {

// Rows onto an even grid: the grid follows the stamps slowly, so that one that strays does not make
// a row more or less.
class EvenGrid {
 public:
  // Steps of the grid since the row before; the first row has none.
  std::int64_t steps_to(double t, double T_s);

 private:
  std::optional<double> at_;  // s, of the grid at the row before
  double rows_ = 0;           // that the grid has followed, since the last gap
};

class ClockScan {
 public:
  void add(double t, const double* theta_m, double T_s);
  struct Stamps {
    bool stray = false;   // by so much that it matters
    bool uneven = false;  // and the rows with them
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
  // Of the intervals that are no gaps, in T_s: how many, off the multiples of T_s; sums.
  std::size_t intervals_ = 0, off_ = 0, pairs_ = 0;
  double time_ = 0, squares_ = 0, products_ = 0, stray_squares_ = 0;
  // Of second differences: the angle's, the stamps' times omega_m.
  std::size_t turning_ = 0;
  double angle_squares_ = 0, stamp_squares_ = 0, both_ = 0;
};

// The rows of an uneven log at even times: currents, angle and the like by the cubic through four
// rows, the voltage, in stator axes, as its mean over each even interval. Gaps stay gaps.
RawLog even_rows(const RawLog& raw, int n_p, double T_s);

}  // namespace twinrate

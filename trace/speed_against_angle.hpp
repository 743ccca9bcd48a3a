// The log's own speed against its angle. Over a window, the change of the angle less the integral
// of the speed has two parts: the lag of the speed times its change, whatever filter caused the
// lag, and a part in proportion to the angle, which a wrong scale causes.
//
//   turned = integral of omega_m / scale + lag (omega_m at the end - at the beginning) / scale
#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <optional>

namespace twinrate {

class SpeedAgainstAngle {
 public:
  // Rows in order, T_s apart; a missing row begins another window.
  void add(double t, double theta_m, double omega_m, double T_s);

  struct Difference {
    double lag_s = 0;  // of omega_m behind theta_m; 0: none visible
    double scale = 1;  // of omega_m; 1: no error visible
    // Share of the rows up to which the speed turns by whole turns more than theta_m shows; none: too
    // few rows.
    std::optional<double> hidden_turns;
  };
  Difference difference() const;

 private:
  struct Row {
    double t, theta_m, omega_m, turned, integral;  // the last two since the window's beginning
  };
  std::deque<Row> rows_;
  std::size_t since_last_ = 0, windows_ = 0;
  std::size_t steps_ = 0, hidden_ = 0;  // rows that the rotor turns up to; with whole turns hidden
  Eigen::Matrix3d products_ = Eigen::Matrix3d::Zero();  // of gained, integral and turned
};

}  // namespace twinrate

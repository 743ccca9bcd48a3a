// The log's own speed against its angle: over a window the angle turned less the integral of the
// speed is the lag of the speed times its change, whatever filter made it, and what is left in
// proportion to the angle is a wrong scale.
//
//   turned = integral of omega_m / scale + lag (omega_m at the end - at the beginning) / scale
#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <deque>

namespace twinrate {

class SpeedAgainstAngle {
 public:
  // Rows in order, T_s apart; rows that are missing begin another window.
  void add(double t, double theta_m, double omega_m, double T_s);

  struct Difference {
    double lag_s = 0;  // of omega_m behind theta_m; 0: none that shows
    double scale = 1;  // of omega_m; 1: none that shows
  };
  Difference difference() const;

 private:
  struct Row {
    double t, theta_m, omega_m, turned, integral;  // the last two since the window's beginning
  };
  std::deque<Row> rows_;
  std::size_t since_last_ = 0, windows_ = 0;
  Eigen::Matrix3d products_ = Eigen::Matrix3d::Zero();  // of gained, integral and turned
};

}  // namespace twinrate

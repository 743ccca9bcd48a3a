// The log of a drawn case: the project's plant under a PI current and speed control of its own,
// with one tick of computation delay and a limit of the voltage.
//
// The angle of the control is the reading; its speed the difference of two readings through a
// first-order filter. An encoder with counts reads floor(theta_m/step) step. Sine and cosine read
// theta_m and white noise.
#pragma once
#include "bench/blind/drawn_case.hpp"

namespace twinrate::blind {

// One tick as the logger sees it.
struct Tick {
  Vec3 i_abc = Vec3::Zero();
  Vec2 u_alphabeta = Vec2::Zero();  // from this tick to the next
  double t = 0, theta_m = 0, omega_m = 0, omega_ref = 0, v_dc = 0, T_load = 0, i_d_ref = 0;
  bool there = true;
};
std::vector<Tick> simulate(const DrawnCase& which);
// The voltage of the row that begins at tick k.
Vec2 row_voltage(const DrawnCase& which, const std::vector<Tick>& ticks, std::size_t k);

struct DrawnLog {
  std::vector<std::string> columns;
  std::vector<std::vector<double>> rows;
  // Without effects that no row of the log shows: a limit of the converter that is never reached.
  std::vector<std::string> truth;
  double largest_current = 0, largest_speed = 0;  // A, rad/s
  bool ran_away = false;  // the loop did not hold the drive: no log to judge on
};

DrawnLog make_log(const DrawnCase& which);
// Writes a CSV, gzipped. Throws BadInput.
void write_csv(const DrawnLog& log, const std::string& path);

}  // namespace twinrate::blind

// The log of a drawn case: the project's plant under a separate PI current and speed control, with
// one tick of computation delay and a voltage limit.
//
// The control uses the reading of the angle. Its speed is the difference of two readings through a
// first-order filter. An encoder with counts reads floor(theta_m/step) step, one with sine and
// cosine reads theta_m plus white noise.
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
  // Kinds of the true effects, without a converter limit that no row reaches.
  std::vector<std::string> truth;
  double largest_current = 0, largest_speed = 0;  // A, rad/s
  bool ran_away = false;                          // the loop lost the drive: the log is not used
};

DrawnLog make_log(const DrawnCase& which);
// The rows of ticks, without the truth.
DrawnLog log_of(const DrawnCase& which, const std::vector<Tick>& ticks);
// Writes a CSV, gzipped. Throws BadInput.
void write_csv(const DrawnLog& log, const std::string& path);

}  // namespace twinrate::blind

// A log with little more than an angle and a current: theta_m and i_q, optionally the speed that
// the driver reports and the voltage of its current controller. Sampling may be irregular. Each
// file may have its own zero of the angle.
//
// There are two kinds of log, distinguished by the motion of the rotor under the torque:
//   quasi-static  the inertia's torque is negligible beside the motor's: the current holds the
//                 rotor against cogging and friction. A holding-current map has no time at all.
//   dynamic       the current accelerates the rotor, or its momentum carries it through the
//                 periods of the cogging (a steady speed).
#pragma once
#include <string>
#include <vector>

#include "model/machine.hpp"

namespace twinrate {

struct PositionLog {
  std::string path;
  std::vector<double> t;  // empty: a map of holding currents
  std::vector<double> theta_m, i_q;
  std::vector<double> omega_m, u_q;  // empty if the file has none
  bool held_out = false;
  std::vector<char> judges = {};  // rows that no fit sees, of a log that is not held out; or empty

  std::size_t size() const { return theta_m.size(); }
  bool has_time() const { return !t.empty(); }
};

// Median step of time, s; 0 for a map.
double sample_interval(const PositionLog& log);

// Standard deviation of the part that differs from row to row, from the median third difference, so
// that motion has no influence.
double row_noise(const std::vector<double>& x);
// Noise of the angle: encoder steps and, in rotation, the jitter of the time stamps.
double angle_noise(const PositionLog& log);

// Direction of the motion in every row, -1 or +1. It changes when the angle has come back by
// `backlash` from its extreme (0: ten times the noise of the angle).
std::vector<int> directions(const PositionLog& log, double backlash = 0);

// Change of theta_m over [t - half, t + half] as a second difference over half^2: the mean
// acceleration under a triangle, without a derivative. Rows nearer than half to an end have none.
struct Acceleration {
  std::vector<double> t, acceleration;  // s, rad/s^2
  double half = 0;
};
Acceleration second_difference(const PositionLog& log, double half);

bool is_quasi_static(const PositionLog& log, const MachineParameters& machine);
// True if the log is dynamic. Traced alone, it is a drive log: the torque equation at every row
// uses more of it than the means of position logs do. Beside a quasi-static log it is a position
// log.
bool is_drive_log(const PositionLog& log, const MachineParameters& machine);

// Number of rows in one mean, if means of neighbouring rows judge; 3000 means a log.
std::size_t judged_length(const PositionLog& log);

// Rows of a quasi-static log in which the current holds the rotor: away from jumps (speed over five
// times the median) and from their after-effect in a filter of the current.
std::vector<char> holding_rows(const PositionLog& log, double memory);
// Those of them that judge (`judge`), or those that do not.
std::vector<char> holding_rows(const PositionLog& log, double memory, bool judge);

// Integral of x over t from the first row, x linear between rows.
std::vector<double> running_integral(const std::vector<double>& t, const std::vector<double>& x);
// x at `when`, linear between rows, constant outside.
double value_at(const std::vector<double>& t, const std::vector<double>& x, double when);
// First-order low-pass of x, linear between rows; tau = 0: x itself.
std::vector<double> low_pass(const std::vector<double>& t, const std::vector<double>& x,
                             double tau);

}  // namespace twinrate

// A drive log as the tracer uses it: even sampling, stationary axes, untrusted rows marked.
//
// Rows are T_s apart. Row k: currents and angle are samples at t_k, the voltage is the mean from
// t_k to t_{k+1} in stator axes (contracts, "Measured data").
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "model/frames.hpp"
#include "trace/sensors.hpp"

namespace twinrate {

struct Record {
  std::string source;
  double T_s = 0;
  // Ticks in a row, if its voltage is made from those at its ends (trace/voltage_meaning.hpp); zero:
  // the voltage is the log's, or the mean of several rows.
  double ticks_each = 0;
  std::optional<double> begin_s;  // of the log, if the record is made of parts of one
  int rows_each = 1;              // rows of the log in one row (trace/thinning.hpp)
  std::vector<double> t;
  std::vector<Vec2> u_alphabeta, i_alphabeta;  // empty if the log has none
  std::vector<double> theta_m;                 // unwrapped
  std::vector<double> v_dc, T_load;            // empty if the log has none
  bool load_measured = false;                  // T_load: from a sensor; else set, from its row on
  std::vector<char> electrical_ok;             // voltage and current of the row are usable
  std::vector<char> motion_ok;                 // angle (and current) are usable
  int current_sensors = 3;                     // 2: i_c is -(i_a + i_b)
  bool i_q_alone = false;                      // the log has no i_d; it is assumed 0
  Sensor angle;                                // theta_m is at the centres of its cells

  std::size_t size() const { return t.size(); }
  // Appends another record. Its time is shifted if it begins before this one ends. Nothing is
  // compared across the seam. Throws std::runtime_error, one line, if the two do not match.
  void append(const Record& other);
  bool has_voltage_equation() const { return !u_alphabeta.empty() && !i_alphabeta.empty(); }
};

// The mean of the steps of a unit vector that turns by turn_e (rad) in so many ticks.
double length_of_mean(double turn_e, double ticks);

}  // namespace twinrate

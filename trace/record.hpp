// A drive log as the tracer uses it: even sampling, stationary axes, rows that cannot be trusted
// marked.
//
// Rows stand T_s apart. Row k: currents and angle are samples at t_k, the voltage is the mean from
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
  std::optional<double> begin_s;  // of the log, where the record is parts of one
  int rows_each = 1;              // of the log that make a row (trace/thinning.hpp)
  std::vector<double> t;
  std::vector<Vec2> u_alphabeta, i_alphabeta;  // empty where the log has none
  std::vector<double> theta_m;                 // unwrapped
  std::vector<double> v_dc, T_load;            // empty where the log has none
  bool load_measured = false;                  // T_load: a sensor's; else set, from its row on
  std::vector<char> electrical_ok;             // voltage and current of the row can be used
  std::vector<char> motion_ok;                 // angle (and current) can be used
  int current_sensors = 3;                     // 2: i_c is -(i_a + i_b)
  bool i_q_alone = false;                      // the log has no i_d: taken for 0
  Sensor angle;                                // theta_m stands at the centres of its cells

  std::size_t size() const { return t.size(); }
  // Adds another record behind this one, its time moved on where it begins before this one ends;
  // nothing is compared across the seam. Throws std::runtime_error, one line, where the two do
  // not go together.
  void append(const Record& other);
  bool has_voltage_equation() const { return !u_alphabeta.empty() && !i_alphabeta.empty(); }
};

}  // namespace twinrate

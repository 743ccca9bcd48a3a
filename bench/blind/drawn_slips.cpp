#include "bench/blind/drawn_slips.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate::blind {
namespace {

constexpr double kSqrt2 = 1.41421356237309505, kSqrt3 = 1.73205080756887729;

// Index of the column; -1: the log has none.
int column(const DrawnLog& log, const std::string& name) {
  const auto at = std::find(log.columns.begin(), log.columns.end(), name);
  return at == log.columns.end() ? -1 : static_cast<int>(at - log.columns.begin());
}

// value -> change(value) in each of the columns that the log has; false: it has none.
template <class F>
bool change(DrawnLog& log, std::initializer_list<const char*> names, F&& f) {
  bool any = false;
  for (const char* name : names)
    if (const int j = column(log, name); j >= 0) {
      any = true;
      for (auto& row : log.rows) {
        double& x = row[static_cast<std::size_t>(j)];
        x = f(x);
      }
    }
  return any;
}
bool scale(DrawnLog& log, std::initializer_list<const char*> names, double by) {
  return change(log, names, [by](double x) { return by * x; });
}
bool currents(DrawnLog& log, double by) {
  return scale(log, {"i_a", "i_b", "i_c", "i_q"}, by);
}
bool voltages(DrawnLog& log, double by) {
  return scale(log, {"u_d", "u_q"}, by);
}
bool swap(DrawnLog& log, const char* a, const char* b) {
  const int i = column(log, a), j = column(log, b);
  if (i < 0 || j < 0) return false;
  for (auto& row : log.rows)
    std::swap(row[static_cast<std::size_t>(i)], row[static_cast<std::size_t>(j)]);
  return true;
}
// Row k gets the value of row k + rows in each of the columns.
bool shift(DrawnLog& log, std::initializer_list<const char*> names, int rows) {
  const DrawnLog was = log;
  bool any = false;
  for (const char* name : names)
    if (const int j = column(log, name); j >= 0) {
      any = true;
      for (int k = 0; k < static_cast<int>(log.rows.size()); ++k) {
        const int from = std::clamp(k + rows, 0, static_cast<int>(log.rows.size()) - 1);
        log.rows[static_cast<std::size_t>(k)][static_cast<std::size_t>(j)] =
            was.rows[static_cast<std::size_t>(from)][static_cast<std::size_t>(j)];
      }
    }
  return any;
}

// Another motor of the same size, twice as long and wound for half the speed.
bool another_machine(DrawnMachine& d) {
  MachineParameters& m = d.machine;
  m.psi_f *= 1.8, m.R_s *= 2.3, m.L_d *= 3.2, m.L_q *= 3.2, m.J *= 2.1;
  return true;
}

}  // namespace

const std::vector<Slip>& slips() {
  using D = DrawnMachine;
  using L = DrawnLog;
  static const std::vector<Slip> kSlips = {
      {"i_a and i_b swapped", {}, [](D&, L& l) { return swap(l, "i_a", "i_b"); }},
      {"i_b and i_c swapped", {}, [](D&, L& l) { return swap(l, "i_b", "i_c"); }},
      {"phases shifted by one",
       {},
       [](D&, L& l) { return swap(l, "i_a", "i_b") && swap(l, "i_b", "i_c"); }},
      {"i_b with the other sign", {}, [](D&, L& l) { return scale(l, {"i_b"}, -1); }},
      {"all currents with the other sign", {}, [](D&, L& l) { return currents(l, -1); }},
      {"i_c zero", {}, [](D&, L& l) { return scale(l, {"i_c"}, 0); }},
      {"currents in mA", {}, [](D&, L& l) { return currents(l, 1e3); }},
      {"currents rms", {}, [](D&, L& l) { return currents(l, 1 / kSqrt2); }},
      {"currents without the 2/3", {}, [](D&, L& l) { return currents(l, 1.5); }},
      {"currents half", {}, [](D&, L& l) { return currents(l, 0.5); }},
      {"voltages line to line", {}, [](D&, L& l) { return voltages(l, kSqrt3); }},
      {"voltages as a share of v_dc", {}, [](D& d, L& l) { return voltages(l, 1 / d.v_dc); }},
      {"voltages with the other sign", {}, [](D&, L& l) { return voltages(l, -1); }},
      {"u_d and u_q swapped", {}, [](D&, L& l) { return swap(l, "u_d", "u_q"); }},
      {"voltages a row early",
       {"signal_lag"},
       [](D&, L& l) {
         return shift(l, {"u_d", "u_q"}, 1);
       }},
      {"voltages a row late",
       {"signal_lag"},
       [](D&, L& l) {
         return shift(l, {"u_d", "u_q"}, -1);
       }},
      {"v_dc in mV", {}, [](D&, L& l) { return scale(l, {"v_dc"}, 1e3); }},
      {"angle with the other sign", {}, [](D&, L& l) { return scale(l, {"theta_m"}, -1); }},
      {"angle in degrees", {}, [](D&, L& l) { return scale(l, {"theta_m"}, 360 / kTwoPi); }},
      {"angle in turns", {}, [](D&, L& l) { return scale(l, {"theta_m"}, 1 / kTwoPi); }},
      {"electrical angle",
       {},
       [](D& d, L& l) {
         return change(l, {"theta_m"}, [&](double x) { return wrap_turn(d.machine.n_p * x); });
       }},
      {"angle of 3 decimals",
       {},
       [](D&, L& l) {
         return change(l, {"theta_m"}, [](double x) { return std::round(1e3 * x) / 1e3; });
       }},
      {"angle turned by 90 degrees electrical",
       {"encoder_offset"},
       [](D& d, L& l) {
         return change(l, {"theta_m"},
                       [&](double x) { return wrap_turn(x + kPi / 2 / d.machine.n_p); });
       }},
      {"angle turned by half an electrical turn",
       {"encoder_offset"},
       [](D& d, L& l) {
         return change(l, {"theta_m"},
                       [&](double x) { return wrap_turn(x + kPi / d.machine.n_p); });
       }},
      {"angle behind a gear of 5",
       {},
       [](D&, L& l) {
         double last = 0, sum = 0;
         return change(l, {"theta_m"}, [&](double x) {
           sum += wrap_pi(x - last), last = x;
           return sum / 5;
         });
       }},
      {"time in ms", {}, [](D&, L& l) { return scale(l, {"t"}, 1e3); }},
      {"time twice as fast", {}, [](D&, L& l) { return scale(l, {"t"}, 0.5); }},
      {"time half as fast", {}, [](D&, L& l) { return scale(l, {"t"}, 2); }},
      {"omega_m in rpm", {}, [](D&, L& l) { return scale(l, {"omega_m"}, 60 / kTwoPi); }},
      {"omega_m with the other sign", {}, [](D&, L& l) { return scale(l, {"omega_m"}, -1); }},
      {"load with the other sign", {}, [](D&, L& l) { return scale(l, {"T_load"}, -1); }},
      {"load in mNm", {}, [](D&, L& l) { return scale(l, {"T_load"}, 1e3); }},
      {"load half", {}, [](D&, L& l) { return scale(l, {"T_load"}, 0.5); }},
      {"poles as pole pairs",
       {},
       [](D& d, L&) {
         d.machine.n_p *= 2;
         return true;
       }},
      {"one pole pair more",
       {},
       [](D& d, L&) {
         d.machine.n_p += 1;
         return true;
       }},
      {"psi_f rms",
       {"flux_linkage"},
       [](D& d, L&) {
         d.machine.psi_f /= kSqrt2;
         return true;
       }},
      {"psi_f line to line",
       {"flux_linkage"},
       [](D& d, L&) {
         d.machine.psi_f *= kSqrt3;
         return true;
       }},
      {"psi_f half",
       {"flux_linkage"},
       [](D& d, L&) {
         d.machine.psi_f /= 2;
         return true;
       }},
      {"R_s and L line to line",
       {"resistance", "inductance"},
       [](D& d, L&) {
         d.machine.R_s *= 2, d.machine.L_d *= 2, d.machine.L_q *= 2;
         return true;
       }},
      {"R_s line to line",
       {"resistance"},
       [](D& d, L&) {
         d.machine.R_s *= 2;
         return true;
       }},
      {"L in the file ten times",
       {"inductance"},
       [](D& d, L&) {
         d.machine.L_d *= 10, d.machine.L_q *= 10;
         return true;
       }},
      {"J in the file ten times",
       {"inertia"},
       [](D& d, L&) {
         d.machine.J *= 10;
         return true;
       }},
      {"J in the file a tenth",
       {"inertia"},
       [](D& d, L&) {
         d.machine.J /= 10;
         return true;
       }},
      {"another machine",
       {"flux_linkage", "resistance", "inductance", "inertia"},
       [](D& d, L&) { return another_machine(d); }},
  };
  return kSlips;
}

}  // namespace twinrate::blind

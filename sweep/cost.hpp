// Load of a small processor by an estimator, from the times of its two parts.
//
//   share of the processor = f_s t_fast + f_b t_background
//   f_emax                 = f_b / gains an electrical turn; no limit by f_b if the gain is turned
//                            with the rotor or read from a table
//
// Dilys 2021, Tables 2 and 4: t_fast = 4.4 + 1.7 us, t_background = 13.4 + 5.4 + 9.6 + 3.2 us. The
// paper prints 6.21 % for 500 Hz, which is the value of 1 kHz; its own times give 4.63 %.
#pragma once
#include <string>
#include <vector>

namespace twinrate::sweep {

struct Halves {
  double fast_s = 6.1e-6, background_s = 31.6e-6;
};

inline double processor_share(const Halves& t, double f_s_Hz, double f_b_Hz) {
  return f_s_Hz * t.fast_s + f_b_Hz * t.background_s;
}

// The table, for `sweep cost`.
std::string cost_table(const Halves& paper, double f_s_Hz, const std::vector<double>& f_b_Hz,
                       double gains_a_turn);

}  // namespace twinrate::sweep

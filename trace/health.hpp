// Data health, before anything is fitted: what the samples themselves show.
//
//   missing rows      steps of time that are whole multiples of the sampling interval
//   stale rows        every noisy signal repeats the row before
//   clipped currents  the largest value stands in many neighbouring rows
//   coarse ADC        the step between values, against the noise and the declared step
//
// Short gaps (up to two rows) are bridged by straight lines, longer ones and clipped rows are left
// out of the trace.
#pragma once
#include <string>
#include <vector>

#include "trace/record.hpp"

namespace twinrate {

// A measured file: columns by canonical name, as tools/import reads them.
struct RawLog {
  std::string path;
  std::vector<double> t;
  // Empty where the file has no such column. i: phases, or alpha beta, or d q.
  std::vector<double> i_a, i_b, i_c, i_alpha, i_beta, i_d, i_q;
  std::vector<double> u_alpha, u_beta, u_d, u_q, v_dc, theta_m, omega_m, T_load, temperature;
};

struct Health {
  std::size_t rows = 0;
  double missing_share = 0, stale_share = 0;
  double i_lsb = 0;    // A, step between values of the phase currents; 0: none seen
  double i_limit = 0;  // A, where they are clipped; 0: nowhere
  double clipped_share = 0;
  double jitter = 0;  // of the time stamps, rms over T_s
  // The ADC's step is what limits the current.
  bool coarse(double i_rated) const { return i_lsb > 0.005 * (i_rated > 0 ? i_rated : 7); }
  // Of several logs together.
  void combine(const Health& other);
};

// Even sampling with bad rows marked. Throws std::runtime_error with one line where the signals do
// not make a record (no angle, no current).
Record make_record(const RawLog& raw, int n_p, Health& health);

}  // namespace twinrate

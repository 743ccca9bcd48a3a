#include "trace/measured.hpp"

namespace twinrate {

void append_row(RawLog& raw, const Measurement& m, const Vec2& u_next, const double* T_load,
                int columns, int n_p) {
  const int needed = kPhaseCurrents | kPosition | (columns & kEveryColumn & ~kVoltage);
  if ((m.signals & needed) != needed) return;  // a lost row
  raw.t.push_back(1e-9 * static_cast<double>(m.t_ns));
  if (columns & kQCurrentOnly) {
    raw.i_q.push_back(park(clarke(m.i_abc), n_p * m.theta_m)[1]);
  } else {
    raw.i_a.push_back(m.i_abc[0]);
    raw.i_b.push_back(m.i_abc[1]);
    raw.i_c.push_back(m.i_abc[2]);
  }
  if (columns & kVoltage) {
    raw.u_alpha.push_back(u_next[0]);
    raw.u_beta.push_back(u_next[1]);
  }
  if (columns & kBusVoltage) raw.v_dc.push_back(m.v_dc);
  raw.theta_m.push_back(m.theta_m);
  if (columns & kSpeed) raw.omega_m.push_back(m.omega_m);
  if (T_load) raw.T_load.push_back(*T_load);
}

RawLog raw_log_of(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last) {
  RawLog raw;
  raw.path = "rolling window";
  int columns = 0;  // that any row has: a row without one of them is lost
  for (std::size_t n = first; n < last; ++n) columns |= rows[n].m.signals & kEveryColumn;
  for (std::size_t n = first; n + 1 < last; ++n)
    append_row(raw, rows[n].m, rows[n + 1].m.u_alphabeta, &rows[n].T_load, columns);
  return raw;
}

}  // namespace twinrate

// Messages of a run as a raw log: rows of the tracer out of MEASUREMENTs.
#pragma once
#include <deque>

#include "core/declared_load.hpp"
#include "trace/health.hpp"

namespace twinrate {

// One tick: what was measured, and the external load that the drive file declares for it.
struct MeasuredRow {
  Measurement m;
  double T_load = 0;
};

// Signals that a log may leave out; without one its column stays empty.
inline constexpr int kEveryColumn = kVoltage | kBusVoltage | kSpeed;
// Adds the row of `m` where it holds phase currents, an angle and `columns`. `u_next`: voltage from
// t_k on, which is that of the measurement behind. `T_load` null: not known. With kQCurrentOnly in
// `columns` the phase currents are those of an i_q, in rotor axes of `n_p`, and no voltage.
void append_row(RawLog& raw, const Measurement& m, const Vec2& u_next, const double* T_load,
                int columns = kEveryColumn, int n_p = 0);
// Rows [first, last) of a window; the last one gives the voltage of the one before it.
RawLog raw_log_of(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last);

}  // namespace twinrate

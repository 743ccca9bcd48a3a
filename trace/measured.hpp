// MEASUREMENT messages of a run as a raw log for the tracer.
#pragma once
#include <deque>

#include "core/declared_load.hpp"
#include "trace/health.hpp"

namespace twinrate {

// One tick: the measurement, and the external load that the drive file declares for it.
struct MeasuredRow {
  Measurement m;
  double T_load = 0;
};

// Signals that a log may lack; the column of a missing signal stays empty.
inline constexpr int kEveryColumn = kVoltage | kBusVoltage | kSpeed;
// Adds the row of `m` if it holds phase currents, an angle and `columns`. `u_next`: voltage from
// t_k on, which the next measurement holds. `T_load` null: unknown. With kQCurrentOnly in `columns`
// the row has i_q, in rotor axes of `n_p`, instead of the phase currents, and no voltage.
void append_row(RawLog& raw, const Measurement& m, const Vec2& u_next, const double* T_load,
                int columns = kEveryColumn, int n_p = 0);
// Rows [first, last) of a window. The last one only gives the voltage of the row before it.
RawLog raw_log_of(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last);

}  // namespace twinrate

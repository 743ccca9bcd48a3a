// Messages of a run as a raw log: rows of the tracer out of MEASUREMENTs.
#pragma once
#include <deque>

#include "core/drive_config.hpp"
#include "trace/health.hpp"

namespace twinrate {

// One tick: what was measured, and the external load that the drive file declares for it.
struct MeasuredRow {
  Measurement m;
  double T_load = 0;
};

// Follows the declared load of a drive from tick 0 on, as the simulated plant applies it.
class DeclaredLoad {
 public:
  explicit DeclaredLoad(const DriveConfig& drive) : load_(drive.load), T_s_(drive.T_s()) {}
  double at(double t_s) {
    T_load_ = slew(T_load_, load_.T_load_Nm.at(t_s), load_.slew_Nm_s, T_s_);
    return T_load_;
  }
  double now() const { return T_load_; }
  void go_on_from(double T_load) { T_load_ = T_load; }

 private:
  LoadParameters load_;
  double T_s_, T_load_ = 0;
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

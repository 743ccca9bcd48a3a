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

// Adds the row of `m` where it holds phase currents and an angle. `u_next`: voltage from t_k on,
// which is that of the measurement behind. `T_load` null: not known.
void append_row(RawLog& raw, const Measurement& m, const Vec2& u_next, const double* T_load);
// Rows [first, last) of a window; the last one gives the voltage of the one before it.
RawLog raw_log_of(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last);

}  // namespace twinrate

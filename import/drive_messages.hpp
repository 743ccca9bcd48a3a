// Rows of a measured file as MEASUREMENT and REFERENCE on the tick grid of a drive.
//
//   k      round((t - t_0) f_s), strictly rising: if the slot is occupied, the next free slot
//   t_ns   t - t_0 as measured: the jitter stays in the log
//   MEASUREMENT(k) of row r
//          currents, angle, speed and v_dc of row r; voltage and duty of row r-1, applied from
//          t_{r-1} to t_r. Row 0 repeats its own voltage.
//
// u_d, u_q are in the axes of theta_m of their own row. Without a voltage column the voltage is
// duty times v_dc of the row or, without that column, times the drive's nominal v_dc.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "import/drive_rows.hpp"

namespace twinrate {

struct TickGrid {
  struct Slot {
    std::size_t row;
    std::int64_t k;
  };
  std::vector<Slot> slots;  // one for each MEASUREMENT
  double dt_min_s = 0, dt_median_s = 0, dt_max_s = 0;
  std::int64_t gaps = 0, missing = 0;       // runs of empty ticks; number of empty ticks
  std::int64_t moved = 0, crowded_out = 0;  // rows not on their nearest tick; rows without a slot
};

inline constexpr double kMaxCrowdedOut = 0.05;  // share of the rows

// Throws BadInput if the share of rows without a slot exceeds kMaxCrowdedOut: the rows are faster
// than f_s.
TickGrid place_on_grid(const DriveRows& rows, double f_s_Hz);

class DriveMessages {
 public:
  // Chooses the columns of currents and voltages. Throws BadInput if the rows hold no signal of a
  // MEASUREMENT.
  DriveMessages(const DriveRows& rows, int n_p, double v_dc_nominal);

  Measurement measurement(const TickGrid::Slot& slot) const;
  bool has_reference() const { return rows_.has("omega_m_ref") || rows_.has("i_d_ref"); }
  Reference reference(const TickGrid::Slot& slot) const;

  int signals() const { return signals_; }
  // For the summary: names of the signals found; canonical columns without a field in the log.
  std::vector<std::string> found() const;
  std::vector<std::string> no_place() const;

 private:
  enum class Currents { kNone, kAbc, kAlphaBeta, kDq, kQOnly };
  enum class Voltages { kNone, kAlphaBeta, kDq, kDuty };
  double value(const char* name, std::size_t row) const {
    return rows_.has(name) ? rows_.at(name, row) : 0.0;
  }
  double theta_e(std::size_t row) const { return n_p_ * value("theta_m", row); }
  bool has_all(std::initializer_list<const char*> names) const;
  Vec3 currents(std::size_t row) const;
  Vec2 voltage(std::size_t row) const;
  std::int64_t t_ns(std::size_t row) const;

  const DriveRows& rows_;
  int n_p_;
  double v_dc_nominal_;
  Currents currents_ = Currents::kNone;
  Voltages voltages_ = Voltages::kNone;
  bool duty_ = false;
  int signals_ = 0;
};

}  // namespace twinrate

// Data health, before anything is fitted: what the samples themselves show.
//
//   missing rows      steps of time that are whole multiples of the sampling interval
//   stale rows        every noisy signal repeats the row before, and the angle misses its way
//   held currents     the currents alone repeat the row before (trace/held_currents.hpp)
//   clipped currents  the largest value stands in many neighbouring rows
//   coarse ADC        the step between values, against the noise and the declared step
//   speed             late behind the angle, or in another unit (trace/speed_against_angle.hpp)
//   glitches          one to three rows of a signal far away from the rest
//                     (trace/health_faults.hpp)
//   frozen signals    one stands while the others go on (trace/health_faults.hpp)
//   constant signals  one that never changes: of a current, no trace
//   time stamps       that stray, or rows that stand unevenly (trace/health_clock.hpp)
//
// Short gaps (up to two rows) are bridged in rotor axes, the voltage by the row before, and
// glitches as long by straight lines; longer ones, frozen stretches and clipped rows are left out
// of the trace.
#pragma once
#include <span>
#include <string>
#include <vector>

#include "trace/record.hpp"

namespace twinrate {

// A measured file, or a piece of it: columns by canonical name, as import/ reads them.
struct RawLog {
  std::string path;
  std::vector<double> t;
  // Empty where the file has no such column. i: phases, or alpha beta, or d q.
  std::vector<double> i_a, i_b, i_c, i_alpha, i_beta, i_d, i_q;
  std::vector<double> u_alpha, u_beta, u_d, u_q, v_dc, theta_m, omega_m, T_load, temperature;
  bool no_angle = false;       // the file has none: theta_m is 0 throughout
  bool load_measured = false;  // T_load is a sensor's

  std::size_t size() const { return t.size(); }
  // Adds the rows of a piece that has the same columns.
  void append(const RawLog& piece);
  void drop_first(std::size_t rows);
  void clear() { drop_first(size()); }
};

// The columns besides t.
struct RawColumn {
  const char* name;
  std::vector<double> RawLog::*values;
};
std::span<const RawColumn> raw_columns();

// Of each row, but where all stands still: whether every signal that has noise repeats the row
// before; whether they repeat the one before that and not the row before (the angle either), as
// chance does as often. A counter that stands for a row repeats by itself as long as the rotor goes
// by less than a count: such rows are stale by what the angle misses over their run.
struct RepeatedRows {
  std::vector<char> stale, by_chance;
  std::vector<double> missed_way;  // rad, of a stale row's run; kSureWay: whatever the angle
};
inline constexpr double kSureWay = 1e9;  // rad
// True where the angle misses more than the counts of its sensor would hide.
bool beyond_counts(double missed_way, double lsb);
RepeatedRows repeated_rows(const RawLog& raw);
// True where so many rows of either sort are chance.
bool is_chance(std::size_t stale, std::size_t by_chance);
// Rows to each side of one that decide it.
inline constexpr std::size_t kStaleReach = 16;
inline constexpr double kSameCurrent = 1e-7;  // A; nearer are one

// Rows of one signal that are not what was measured.
struct SignalFault {
  std::size_t column = 0;         // of raw_columns()
  double t_begin = 0, t_end = 0;  // s, of the first and the last row
};

struct Health {
  std::size_t rows = 0;
  double T_s = 0;  // sampling interval
  double missing_share = 0, stale_share = 0;
  double held_share = 0;  // rows whose currents alone repeat
  double i_lsb = 0;       // A, step between values of the phase currents; 0: none seen
  Sensor angle;           // steps of theta_m
  double i_limit = 0;     // A, where they are clipped; 0: nowhere
  double clipped_share = 0;
  double jitter = 0;     // of the time stamps (uneven: of the intervals), rms over T_s
  bool stray = false;    // the stamps leave their grid, the rows do not
  bool uneven = false;   // the rows stand unevenly
  double i_sum_max = 0;  // A, of the three phase currents
  double speed_lag = 0;  // s, of omega_m behind theta_m; 0: none that shows
  double speed_scale = 1;
  bool no_angle = false, i_q_alone = false;  // at rest; without i_d, which is taken for 0
  std::vector<SignalFault> glitches, frozen;
  std::vector<std::size_t> constant;  // columns
  std::string blind;                  // why the currents say nothing; empty: they do
  // Else i_c is what the other two make it.
  bool i_c_measured() const { return i_sum_max >= kSumOfPhases; }
  static constexpr double kSumOfPhases = 1e-4;
  // The ADC's step is what limits the current.
  bool coarse(double i_rated) const { return i_lsb > 0.005 * (i_rated > 0 ? i_rated : 7); }
  // Share of rows that were filled in.
  double not_read() const { return missing_share + stale_share + held_share; }
  // Of several logs together.
  void combine(const Health& other);
  // What there is to say of it, one line each.
  std::vector<std::string> lines() const;
};

// Throws std::runtime_error, one line, where the signals do not make a record (no current; no angle
// and no voltage either, which at rest is enough).
void expect_signals(const RawLog& raw);
// Even sampling with bad rows marked; `health` of the log that the rows are of. Throws
// as expect_signals.
Record record_of(const RawLog& raw, int n_p, const Health& health);
// The same of a whole log, `health` its own (trace/health_scan.hpp).
Record make_record(const RawLog& raw, int n_p, Health& health, int encoder_counts = 0);

}  // namespace twinrate

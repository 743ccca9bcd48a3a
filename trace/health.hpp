// Data health from the samples alone, before any fit.
//
//   missing rows      steps of time that are whole multiples of the sampling interval
//   stale rows        every noisy signal repeats the row before, and the angle falls behind
//   held currents     the currents alone repeat the row before (trace/held_currents.hpp)
//   clipped currents  the largest value occurs in many neighbouring rows
//   coarse ADC        the step between values, against the noise and the declared step
//   speed             late behind the angle, or in another unit (trace/speed_against_angle.hpp)
//   glitches          one to three rows of a signal far from the others
//                     (trace/health_faults.hpp)
//   frozen signals    one is constant while the others change (trace/health_faults.hpp)
//   constant signals  one that never changes; with a constant current there is no trace
//   time stamps       stray stamps, or rows at uneven times (trace/health_clock.hpp)
//
// Short gaps (up to two rows) are interpolated in rotor axes, with the voltage of the row before.
// Glitches of that length become straight lines. Longer gaps, frozen stretches and clipped rows are
// left out of the trace.
#pragma once
#include <algorithm>
#include <optional>
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
  bool no_angle = false;       // the file has no angle: theta_m is 0 throughout
  bool load_measured = false;  // T_load comes from a sensor

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

// For each row, except at rest: whether every noisy signal repeats the row before (`stale`), and
// whether they repeat the row before that one and not the row before (`by_chance`; the angle
// repeats either), which chance makes as often. A counter reading repeats without a fault while the
// rotor turns by less than a count. So a row counts as stale only by the angle that its run misses.
struct RepeatedRows {
  std::vector<char> stale, by_chance;
  std::vector<double> missed_way;  // rad, of a stale row's run; kSureWay: stale whatever the angle
};
inline constexpr double kSureWay = 1e9;  // rad
// True if the angle misses more than the counts of its sensor can hide.
bool beyond_counts(double missed_way, double lsb);
RepeatedRows repeated_rows(const RawLog& raw);
// True if so many rows of either sort can be chance.
bool is_chance(std::size_t stale, std::size_t by_chance);
// Number of rows on each side of a row that decide about it.
inline constexpr std::size_t kStaleReach = 16;
inline constexpr double kSameCurrent = 1e-7;  // A; closer values count as equal

// Rows of one signal that hold no measurement.
struct SignalFault {
  std::size_t column = 0;         // of raw_columns()
  double t_begin = 0, t_end = 0;  // s, of the first and the last row
};

// A part of the log without rows.
struct Pause {
  double t_begin, t_end;  // s, of the last row before it and of the first row behind it
};

struct Health {
  std::size_t rows = 0;
  double T_s = 0;  // sampling interval
  double missing_share = 0, stale_share = 0;
  double held_share = 0;  // rows whose currents alone repeat
  double i_lsb = 0;       // A, step between values of the phase currents; 0: none found
  Sensor angle;           // steps of theta_m
  double i_limit = 0;     // A, at which they are clipped; 0: not clipped
  double clipped_share = 0;
  double jitter = 0;     // of the time stamps (uneven: of the intervals), rms over T_s
  bool stray = false;    // the stamps leave their grid, the rows do not
  bool uneven = false;   // the rows come at uneven times
  double i_sum_max = 0;  // A, of the three phase currents
  double i_digit = 0;    // A, last decimal of the largest phase currents; 0: beyond the seventh
  double speed_lag = 0;  // s, of omega_m behind theta_m; 0: none visible
  double speed_scale = 1;
  std::optional<double> hidden_turns;        // share of the rows; none: no omega_m to compare with
  bool no_angle = false, i_q_alone = false;  // assumed at rest; no i_d in the log, assumed 0
  std::vector<SignalFault> glitches, frozen;
  std::vector<Pause> pauses;          // without rows; none if there are many: rows are missing then
  std::vector<std::size_t> constant;  // columns
  std::string blind;                  // why the currents are useless; empty: they are not
  // False: i_c is computed from the other two. Three decimals, each rounded, are up to one and a
  // half apart.
  bool i_c_measured() const { return i_sum_max >= std::max(kSumOfPhases, 1.6 * i_digit); }
  static constexpr double kSumOfPhases = 1e-4;
  // The ADC's step limits the accuracy of the current.
  bool coarse(double i_rated) const { return i_lsb > 0.005 * (i_rated > 0 ? i_rated : 7); }
  // Share of rows that were filled in.
  double not_read() const { return missing_share + stale_share + held_share; }
  // Combines the health of several logs.
  void combine(const Health& other);
  // The findings, one line each.
  std::vector<std::string> lines() const;
};

// Throws std::runtime_error, one line, if the signals make no record: no current, or neither angle
// nor voltage (at rest a voltage suffices).
void expect_signals(const RawLog& raw);
// Even sampling with bad rows marked. `health` is that of the log that contains the rows. Throws as
// expect_signals.
Record record_of(const RawLog& raw, int n_p, const Health& health);
// The same for a whole log; fills its `health` (trace/health_scan.hpp).
Record make_record(const RawLog& raw, int n_p, Health& health, int encoder_counts = 0);

}  // namespace twinrate

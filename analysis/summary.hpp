// The figures of a run, over [settle_s, end]; time counts from the first tick of the log. After a
// start that forces the angle (alignment, I/f ramp) the window begins at the hand-over at the
// earliest: before it the controller does not use the estimate.
//
//   angle error    wrap(theta_e_hat - theta_e) at tick k, into (-pi, pi], electrical
//   speed error    omega_m_hat - omega_m at tick k, mechanical
//   locked         synchronism: every number finite and |angle error| <= pi/2. False after a trip, and
//                  if the estimate never took over. Empty without an angle to compare with, without
//                  estimates, and if the run ended before its window.
//   speed_held     the true speed is off a constant reference by more than 20 % for less than 20 ms
//                  in total. The reference is the slewed one of COMMAND; it is constant at a tick if
//                  it has not changed for 0.1 s. The speed is not judged at a reference of 0. False
//                  after a trip.
//   speed dip      largest shortfall of the true speed below that reference, relative to the reference
//   unevenness     (max - min)/|mean| of the true speed over a turn of the rotor, the median of the
//                  whole turns (at least three): a dip in one turn does not count
//   trip           the first event that ends the control of the motor (is_trip in core/reason.hpp)
//   speed ripple   rms of the true omega_m less its mean, over the last whole turns of the rotor
//                  (at least three); harmonics: orders 1 to 60 only
//
// theta_e is the truth, or n_p times the measured position (AngleReference). In a log without
// truth, omega_m is the slope of the measured position over 10 ms, because the tick-to-tick speed
// of an encoder is mostly quantisation. A figure that cannot be computed (no truth, no position, no
// tick in the window) is empty.
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "analysis/tick_rows.hpp"
#include "core/drive_config.hpp"
#include "core/run_log.hpp"

namespace twinrate {

// Source of the rotor's angle. kAuto: the truth if the log has it, else the measured position.
enum class AngleReference : int { kAuto, kTruth, kEncoder, kNone };
inline constexpr const char* kAngleReferenceNames[] = {"auto", "truth", "encoder", "none"};

// The first cause of a run that ended badly.
struct Trip {
  int reason = 0, role = 0;
  std::int64_t k = -1;
  double t_s = 0;
  std::string text;
};

struct Summary {
  // From the trajectories.
  std::optional<bool> locked;
  std::optional<bool> speed_held;  // empty without truth or a constant reference
  std::optional<double> speed_dip_percent, speed_excess_percent, speed_unevenness_percent;
  bool uneven = false;              // speed not held, by its unevenness
  bool never_at_reference = false;  // at no tick within 20 % of a constant reference
  std::optional<Trip> trip;
  double window_from_s = 0;         // from the first tick of the log
  std::optional<double> lost_at_s;  // first sign of the loss in the whole run, if not locked
  std::string lost_why;             // criterion that failed first
  bool never_handed_over = false;   // the start was not over at the end of the run
  std::optional<double> speed_error_rms, angle_error_rms, angle_error_max;
  std::optional<double> speed_ripple_rms, speed_ripple_harmonics_rms;
  double duration_s = 0;         // from the first to the last tick
  std::int64_t steps = 0;        // ticks in the log
  std::int64_t gains_used = 0;   // distinct gains the fast loop ran on, in the whole run
  bool rates_requested = false;  // a request set n or the gain policy of the drive file anew
  // First tick whose gain is computed every n ticks only (rates.n_from); empty: none.
  std::optional<std::int64_t> n_from_tick;
  std::optional<double> P44_min, P44_max;  // ekf_sensorless: angle variance, gains used, rad^2
  AngleReference angle_reference = AngleReference::kNone;
  // Ticks missing in the log between the first and the last tick of a channel; the supervisor adds
  // the messages lost on the bus.
  std::map<std::string, std::int64_t> lost_messages;
  std::int64_t late_gains = 0;
  // From the processes.
  bool losses_counted = false;  // up to the end of the run; false: only within the log
  std::int64_t repeats = 0, deadline_misses = 0, late_commands = 0;
  // Realtime, of the plant: ticks that began late by more than a period, and the time for which its
  // clock stopped.
  std::int64_t stalls = 0;
  double stalled_s = 0, longest_stall_s = 0;
  double wall_s = 0;
};

Summary summarise(const RunLog& log, const DriveConfig& config,
                  AngleReference angle_reference = AngleReference::kAuto);
// The same from a table of ticks; `head`: path, events and drive file of the log.
struct RunTicks;
Summary summarise(const RunLog& head, const RunTicks& ticks, const DriveConfig& config,
                  AngleReference angle_reference = AngleReference::kAuto);
// The text of summary.json; an empty or not finite figure is null.
std::string to_json(const Summary& summary, const DriveConfig& config);
// Copies the counts of the processes (last block of Summary, lost_messages) from a summary.json.
void take_process_figures(const std::string& summary_json, Summary& summary);

// "uneven", "dipped" or "overshot" if a locked drive did not hold its speed, else "". Uneven: the
// median turn leaves the band of +/-20 %; below three turns, the speed left the band on alternate
// sides kUnevenSides times (two load steps make four). ", never at its reference" is appended if no
// tick was within the band.
std::string speed_word(const Summary& summary);
// "lost_synchronism at 0.5312 s, tick 5312, controller: TEXT"; reason codes by their names.
std::string trip_text(const Trip& trip);

// Electrical reference angle at a tick; NaN without one.
double theta_e_reference(const TickRow& row, AngleReference reference, int n_p);

// wrap(theta_e_hat - theta_e) at a tick; NaN if either angle is missing or not finite.
double angle_error(const TickRow& row, AngleReference reference, int n_p);

// omega_m of each row: the truth, or the slope of the measured position over 10 ms; NaN without
// either.
std::vector<double> reference_speed(TickRows rows, bool has_truth);

// Errors at each tick that has an estimate and a reference angle. An error is NaN if the estimate
// is. Arguments as for summarise().
struct TickError {
  std::int64_t k;
  double t_s, angle_error, speed_error, omega_m;
};
std::vector<TickError> tick_errors(const RunLog& log, const DriveConfig& config,
                                   AngleReference angle_reference = AngleReference::kAuto);

}  // namespace twinrate

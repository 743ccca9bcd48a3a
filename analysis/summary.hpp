// The figures of a run, over [settle_s, end]; time counts from the first tick of the log.
//
//   angle error    wrap(theta_e_hat - theta_e) at tick k, into (-pi, pi], electrical
//   speed error    omega_m_hat - omega_m at tick k, mechanical
//   locked         everything finite, never |angle error| > pi/2, and the true speed away from a
//                  constant reference by more than 20 % for less than 20 ms in total. The reference
//                  is the slewed one of COMMAND; it is constant at a tick where it has not changed
//                  for the last 0.1 s. A reference of 0 has no 20 %.
//   speed ripple   true omega_m less its mean, rms, over the last whole turns of the rotor (three
//                  or more)
//   harmonics      orders 1 to 60 of the speed ripple
//
// theta_e is the truth, or n_p times the measured position (AngleReference). Where a log has no
// truth, omega_m is the slope of the measured position over 10 ms, because an encoder's
// tick-to-tick speed is mostly quantisation. A figure that cannot be formed (no truth, no position,
// no tick in the window) is empty.
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "analysis/tick_rows.hpp"
#include "core/drive_config.hpp"
#include "core/run_log.hpp"

namespace twinrate {

// The reference of the rotor's angle. kAuto: the truth where the log has it, else the measured
// position.
enum class AngleReference : int { kAuto, kTruth, kEncoder, kNone };
inline constexpr const char* kAngleReferenceNames[] = {"auto", "truth", "encoder", "none"};

struct Summary {
  // From the trajectories.
  std::optional<bool> locked;
  std::optional<double> lost_at_s;  // first sign of the loss in the whole run, where not locked ..
  std::string lost_why;             // .. and its reason
  std::optional<double> speed_error_rms, angle_error_rms, angle_error_max;
  std::optional<double> speed_ripple_rms, speed_ripple_harmonics_rms;
  double duration_s = 0;
  std::int64_t steps = 0;       // ticks in the log
  std::int64_t gains_used = 0;  // distinct gains the fast loop ran on, in the whole run
  std::optional<double> P44_min,
      P44_max;  // angle variance of ekf_sensorless, rad^2, of the gains used
  AngleReference angle_reference = AngleReference::kNone;
  // Ticks missing in the log between the first and the last of a channel; a supervisor adds the
  // losses on the wire.
  std::map<std::string, std::int64_t> lost_messages;
  std::int64_t late_gains = 0;
  // From the processes.
  std::int64_t repeats = 0, deadline_misses = 0, late_commands = 0;
  double wall_s = 0;
};

Summary summarise(const RunLog& log, const DriveConfig& config,
                  AngleReference angle_reference = AngleReference::kAuto);
// The keys of summary.json; null where a figure could not be formed or is not finite.
std::string to_json(const Summary& summary, const DriveConfig& config);
// The figures that only the processes know (last block of Summary, lost_messages), from a
// summary.json.
void take_process_figures(const std::string& summary_json, Summary& summary);

// Summary::lost_why where the speed alone speaks against lock. With a position sensor that is no
// loss of synchronism: a large ripple does it.
inline constexpr const char* kLeftReference = "the speed left its reference by more than 20 %";

// kAuto resolved, and kNone where the log does not have the one asked for.
AngleReference resolve(AngleReference wanted, const RunLog& log);
// Electrical reference angle at a tick, NaN where there is none.
double theta_e_reference(const TickRow& row, AngleReference reference, int n_p);

// wrap(theta_e_hat - theta_e) at a tick; NaN where either is missing or not finite.
double angle_error(const TickRow& row, AngleReference reference, int n_p);

// omega_m of each row: the truth, or the slope of the measured position over 10 ms; NaN where there
// is neither.
std::vector<double> reference_speed(const std::vector<TickRow>& rows, bool has_truth);

// Each tick that has an estimate and a reference angle; an error is NaN where the estimate is.
// `angle_reference` and `log` as in summarise().
struct TickError {
  std::int64_t k;
  double t_s, angle_error, speed_error, omega_m;
};
std::vector<TickError> tick_errors(const RunLog& log, const DriveConfig& config,
                                   AngleReference angle_reference = AngleReference::kAuto);

}  // namespace twinrate

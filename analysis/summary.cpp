#include "analysis/summary.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/order_spectrum.hpp"
#include "core/channels.hpp"

namespace twinrate {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kConstantFor_s = 0.1;   // hold time after which a reference is constant
constexpr double kSpeedTolerance = 0.2;  // relative to the reference
constexpr double kOffReferenceMax_s = 0.02;
constexpr double kSlopeSpan_s = 0.01;
constexpr int kRippleTurnsMin = 3;
constexpr int kRippleOrders = 60;

// The square overflows first: a diverged state is detected before its numbers are infinite.
bool finite(double value) {
  return std::isfinite(value * value);
}

bool finite(const Estimate& e) {
  return finite(e.theta_e) && finite(e.omega_m) && finite(e.T_load) && finite(e.x_hat.norm());
}

bool finite(const Truth& t) {
  return finite(t.i_dq.norm()) && finite(t.omega_m) && finite(t.theta_m);
}

// Total time off a constant speed reference.
class OffReferenceTime {
 public:
  explicit OffReferenceTime(double T_s) : T_s_(T_s) {}
  void note_reference(const TickRow& row) {
    if (!row.command) return;
    if (!known_ || row.command->omega_m_ref != omega_m_ref_) changed_s_ = row.t_s;
    known_ = true;
    omega_m_ref_ = row.command->omega_m_ref;
  }
  void add(const TickRow& row, double omega_m) {
    const bool constant = known_ && row.t_s - changed_s_ >= kConstantFor_s - T_s_ / 2;
    if (!constant || std::abs(omega_m - omega_m_ref_) <= kSpeedTolerance * std::abs(omega_m_ref_))
      return;
    if (omega_m_ref_ != 0 && !std::isnan(omega_m)) ++ticks_;
  }
  // Tolerance of half a tick: 20 ms up to rounding count as exceeded.
  bool exceeded() const {
    return static_cast<double>(ticks_) * T_s_ > kOffReferenceMax_s - T_s_ / 2;
  }

 private:
  double T_s_;
  bool known_ = false;
  double omega_m_ref_ = 0, changed_s_ = 0;
  std::int64_t ticks_ = 0;
};

struct Rows {
  std::vector<TickRow> all;
  std::vector<double> omega_m;
  double settled_s = 0;  // start of the window

  bool in_window(const TickRow& row) const { return row.t_s >= settled_s; }
};

Rows rows_of(const RunLog& log, const DriveConfig& config) {
  Rows rows;
  rows.all = tick_rows(log);
  rows.omega_m = reference_speed(rows.all, !log.truth.empty());
  // Tolerance of 1 ns: t_ns is rounded.
  if (!rows.all.empty()) rows.settled_s = rows.all.front().t_s + config.run.settle_s - 1e-9;
  return rows;
}

// The lock criterion that fails at one tick; "" if none fails.
const char* failed_criterion(const TickRow& row, double error) {
  if (row.estimate && !finite(*row.estimate)) return "the estimate is not finite";
  if (row.truth && !finite(*row.truth)) return "the plant's state is not finite";
  return std::abs(error) > kPi / 2 ? "the angle error passed 90 deg" : "";
}

// The window decides the verdict. The time of a loss is searched in the whole run, because most
// losses happen on the start-up ramp.
void set_lock(const Rows& rows, const DriveConfig& config, Summary& summary) {
  OffReferenceTime off_reference(config.T_s());
  bool any = false, lost = false;
  for (std::size_t i = 0; i < rows.all.size(); ++i) {
    const TickRow& row = rows.all[i];
    off_reference.note_reference(row);
    const double error = angle_error(row, summary.angle_reference, config.machine.n_p);
    std::string why = failed_criterion(row, error);
    const bool in_window = rows.in_window(row);
    if (in_window) {
      any = any || !std::isnan(error) || !why.empty();
      off_reference.add(row, rows.omega_m[i]);
      if (why.empty() && off_reference.exceeded()) why = kLeftReference;
      lost = lost || !why.empty();
    }
    // The estimated angle is not judged until the controller uses it.
    const bool forced = row.measurement && row.measurement->mode != Mode::kRun;
    if (why.empty() || summary.lost_at_s || (forced && !in_window)) continue;
    summary.lost_at_s = row.t_s;
    summary.lost_why = why;
  }
  if (any) summary.locked = !lost;
  if (!lost) {
    summary.lost_at_s.reset();
    summary.lost_why.clear();
  }
}

void set_errors(const Rows& rows, const DriveConfig& config, Summary& summary) {
  double angle2 = 0, speed2 = 0, angle_max = 0;
  std::int64_t angles = 0, speeds = 0;
  for (std::size_t i = 0; i < rows.all.size(); ++i) {
    const TickRow& row = rows.all[i];
    if (!rows.in_window(row) || !row.estimate) continue;
    const double angle = angle_error(row, summary.angle_reference, config.machine.n_p);
    const double speed = row.estimate->omega_m - rows.omega_m[i];
    if (std::isfinite(angle))
      angle2 += angle * angle, angle_max = std::max(angle_max, std::abs(angle)), ++angles;
    if (std::isfinite(speed)) speed2 += speed * speed, ++speeds;
  }
  if (angles > 0) {
    summary.angle_error_rms = std::sqrt(angle2 / static_cast<double>(angles));
    summary.angle_error_max = angle_max;
  }
  if (speeds > 0) summary.speed_error_rms = std::sqrt(speed2 / static_cast<double>(speeds));
}

void set_ripple(const Rows& rows, Summary& summary) {
  std::vector<double> theta_m, omega_m;
  for (const TickRow& row : rows.all) {
    if (!rows.in_window(row) || !row.truth) continue;
    theta_m.push_back(row.truth->theta_m);
    omega_m.push_back(row.truth->omega_m);
  }
  const OrderSpectrum spectrum = order_spectrum(theta_m, omega_m, kRippleOrders);
  if (spectrum.turns < kRippleTurnsMin) return;
  double sum = 0, sum2 = 0;
  for (std::size_t i = spectrum.first; i < spectrum.last; ++i) sum += omega_m[i];
  const double count = static_cast<double>(spectrum.last - spectrum.first), mean = sum / count;
  for (std::size_t i = spectrum.first; i < spectrum.last; ++i)
    sum2 += (omega_m[i] - mean) * (omega_m[i] - mean);
  summary.speed_ripple_rms = std::sqrt(sum2 / count);
  summary.speed_ripple_harmonics_rms = spectrum.rms(kRippleOrders);
}

void set_gains(const Rows& rows, const DriveConfig& config, Summary& summary) {
  const bool has_P44 = config.estimator.kind == "ekf_sensorless";
  std::int64_t last_gain = -1;
  for (const TickRow& row : rows.all) {
    if (!row.estimate) continue;
    if (row.estimate->status & kLateGain) ++summary.late_gains;
    if (row.estimate->gain_seq >= 0 && row.estimate->gain_seq != last_gain) {
      ++summary.gains_used;
      last_gain = row.estimate->gain_seq;
    }
    if (!has_P44 || !row.gain || !rows.in_window(row)) continue;
    const double P44 = row.gain->P_diagonal(3);
    summary.P44_min = std::min(summary.P44_min.value_or(P44), P44);
    summary.P44_max = std::max(summary.P44_max.value_or(P44), P44);
  }
}

// Messages of one channel lost between its first and last tick. `intervals`: (first, last) ->
// number of messages expected after the first.
template <class Item, class Intervals>
void count_lost(const std::vector<Item>& items, Intervals intervals, Channel channel,
                Summary& summary) {
  if (items.empty()) return;
  std::int64_t distinct = 1;
  for (std::size_t i = 1; i < items.size(); ++i) distinct += items[i].k != items[i - 1].k;
  summary.lost_messages[info(channel).name] =
      std::max<std::int64_t>(0, intervals(items.front().k, items.back().k) + 1 - distinct);
}

}  // namespace

AngleReference resolve(AngleReference wanted, const RunLog& log) {
  const bool truth = !log.truth.empty();
  const bool encoder = std::any_of(log.measurement.begin(), log.measurement.end(),
                                   [](const Measurement& m) { return m.signals & kPosition; });
  if (truth && (wanted == AngleReference::kAuto || wanted == AngleReference::kTruth))
    return AngleReference::kTruth;
  // A filter that uses the sensor's angle is not judged by that sensor.
  const bool independent =
      std::none_of(log.estimate.begin(), log.estimate.end(),
                   [](const Estimate& e) { return e.status & kMeasuredAngle; });
  if (encoder &&
      (wanted == AngleReference::kEncoder || (wanted == AngleReference::kAuto && independent)))
    return AngleReference::kEncoder;
  return AngleReference::kNone;
}

double theta_e_reference(const TickRow& row, AngleReference reference, int n_p) {
  if (reference == AngleReference::kTruth && row.truth) return n_p * row.truth->theta_m;
  if (reference == AngleReference::kEncoder && row.measurement &&
      (row.measurement->signals & kPosition))
    return n_p * row.measurement->theta_m;
  return kNaN;
}

// wrap_pi(NaN) is 0.
double angle_error(const TickRow& row, AngleReference reference, int n_p) {
  if (!row.estimate) return kNaN;
  const double difference = row.estimate->theta_e - theta_e_reference(row, reference, n_p);
  return std::isfinite(difference) ? wrap_pi(difference) : kNaN;
}

std::vector<double> reference_speed(const std::vector<TickRow>& rows, bool has_truth) {
  std::vector<double> omega_m(rows.size(), kNaN);
  const auto position = [&](std::size_t i) {
    const Measurement* m = rows[i].measurement;
    return m && (m->signals & kPosition) ? m->theta_m : kNaN;
  };
  std::size_t from = 0, to = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (has_truth) {
      if (rows[i].truth) omega_m[i] = rows[i].truth->omega_m;
      continue;
    }
    while (rows[from].t_s < rows[i].t_s - kSlopeSpan_s / 2) ++from;
    while (to + 1 < rows.size() && rows[to + 1].t_s <= rows[i].t_s + kSlopeSpan_s / 2) ++to;
    if (rows[to].t_s > rows[from].t_s)
      omega_m[i] = (position(to) - position(from)) / (rows[to].t_s - rows[from].t_s);
  }
  return omega_m;
}

std::vector<TickError> tick_errors(const RunLog& log, const DriveConfig& config,
                                   AngleReference angle_reference) {
  const AngleReference reference = resolve(angle_reference, log);
  const Rows rows = rows_of(log, config);
  std::vector<TickError> errors;
  for (std::size_t i = 0; i < rows.all.size(); ++i) {
    const TickRow& row = rows.all[i];
    if (!row.estimate || std::isnan(theta_e_reference(row, reference, config.machine.n_p)))
      continue;
    errors.push_back({row.k, row.t_s, angle_error(row, reference, config.machine.n_p),
                      row.estimate->omega_m - rows.omega_m[i], rows.omega_m[i]});
  }
  return errors;
}

Summary summarise(const RunLog& log, const DriveConfig& config, AngleReference angle_reference) {
  Summary summary;
  summary.angle_reference = resolve(angle_reference, log);
  const Rows rows = rows_of(log, config);
  summary.steps =
      static_cast<std::int64_t>(log.measurement.empty() ? rows.all.size() : log.measurement.size());
  summary.duration_s = static_cast<double>(summary.steps) * config.T_s();
  set_lock(rows, config, summary);
  set_errors(rows, config, summary);
  set_ripple(rows, summary);
  set_gains(rows, config, summary);
  const auto every_tick = [](std::int64_t first, std::int64_t last) { return last - first; };
  count_lost(log.measurement, every_tick, Channel::kMeasurement, summary);
  count_lost(log.truth, every_tick, Channel::kTruth, summary);
  count_lost(log.estimate, every_tick, Channel::kEstimate, summary);
  count_lost(log.command, every_tick, Channel::kCommand, summary);
  count_lost(
      log.gain, [&](auto first, auto last) { return config.gains_between(first, last); },
      Channel::kGain, summary);
  return summary;
}

}  // namespace twinrate

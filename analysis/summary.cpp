#include "analysis/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/order_spectrum.hpp"
#include "core/channels.hpp"
#include "core/reason.hpp"

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

// The true speed against a constant reference: time off it, largest deviations, unevenness a turn.
class SpeedFigures {
 public:
  explicit SpeedFigures(double T_s) : T_s_(T_s) {}
  void note_reference(const TickRow& row) {
    if (!row.command) return;
    if (!known_ || row.command->omega_m_ref != omega_m_ref_) changed_s_ = row.t_s;
    known_ = true;
    omega_m_ref_ = row.command->omega_m_ref;
  }
  void add(const TickRow& row, double omega_m) {
    const bool constant = known_ && row.t_s - changed_s_ >= kConstantFor_s - T_s_ / 2;
    if (!constant || omega_m_ref_ == 0 || std::isnan(omega_m)) {
      turn_ = {};
      return;
    }
    judged_ = true;
    const double deviation = omega_m / omega_m_ref_ - 1;
    if (std::abs(deviation) > kSpeedTolerance) ++ticks_;
    below_ = std::max(below_, -deviation);
    above_ = std::max(above_, deviation);
    if (row.truth)
      add_to_turn(omega_m_ref_ < 0 ? -row.truth->theta_m : row.truth->theta_m,
                  std::abs(omega_m_ref_) * (1 + deviation));
  }
  // Tolerance of half a tick: 20 ms up to rounding count as exceeded.
  bool held() const { return static_cast<double>(ticks_) * T_s_ <= kOffReferenceMax_s - T_s_ / 2; }
  void write(Summary& summary) {
    if (!judged_) return;
    summary.speed_held = held();
    summary.speed_dip_percent = 100 * below_;
    const bool some_turns = static_cast<int>(unevenness_.size()) >= kRippleTurnsMin;
    if (some_turns) {
      const auto middle = unevenness_.begin() + static_cast<std::ptrdiff_t>(unevenness_.size() / 2);
      std::nth_element(unevenness_.begin(), middle, unevenness_.end());
      summary.speed_unevenness_percent = 100 * *middle;
    }
    // Below three turns: on both sides of the reference.
    summary.uneven =
        !held() && (some_turns ? *summary.speed_unevenness_percent > 200 * kSpeedTolerance
                               : std::min(below_, above_) > kSpeedTolerance);
  }

 private:
  struct Turn {
    double begin = 0, least = 0, greatest = 0, sum = 0;
    std::int64_t count = 0;
  };
  // `theta_m` and `omega_m` in the direction of the reference.
  void add_to_turn(double theta_m, double omega_m) {
    if (turn_.count == 0) turn_ = {theta_m, omega_m, omega_m};
    turn_.least = std::min(turn_.least, omega_m);
    turn_.greatest = std::max(turn_.greatest, omega_m);
    turn_.sum += omega_m;
    ++turn_.count;
    if (theta_m - turn_.begin < kTwoPi) return;
    unevenness_.push_back((turn_.greatest - turn_.least) * static_cast<double>(turn_.count) /
                          turn_.sum);
    turn_ = {};
  }

  double T_s_;
  bool known_ = false, judged_ = false;
  double omega_m_ref_ = 0, changed_s_ = 0;
  std::int64_t ticks_ = 0;
  double below_ = 0, above_ = 0;
  Turn turn_;
  std::vector<double> unevenness_;
};

bool is_forced(const TickRow& row) {
  return row.measurement &&
         (row.measurement->mode == Mode::kAlign || row.measurement->mode == Mode::kIfRamp);
}

struct Rows {
  std::vector<TickRow> all;
  std::vector<double> omega_m;
  double settled_s = 0;  // start of the window

  bool in_window(const TickRow& row) const { return row.t_s >= settled_s && !is_forced(row); }
};

Rows rows_of(const RunLog& log, const DriveConfig& config) {
  Rows rows;
  rows.all = tick_rows(log);
  rows.omega_m = reference_speed(rows.all, !log.truth.empty());
  if (rows.all.empty()) return rows;
  // Tolerance of 1 ns: t_ns is rounded.
  rows.settled_s = rows.all.front().t_s + config.run.settle_s - 1e-9;
  auto row = rows.all.begin();
  if (std::find_if(row, rows.all.end(), is_forced) == rows.all.end()) return rows;
  // The first command needs plant.delay_samples ticks to act.
  while (!is_forced(*row)) ++row;
  while (row != rows.all.end() && is_forced(*row)) ++row;
  const bool handed_over = row != rows.all.end();
  rows.settled_s = std::max(rows.settled_s, (handed_over ? *row : rows.all.back()).t_s);
  return rows;
}

// The lock criterion that fails at one tick; "" if none fails.
const char* failed_criterion(const TickRow& row, double error) {
  if (row.estimate && !finite(*row.estimate)) return "the estimate is not finite";
  if (row.truth && !finite(*row.truth)) return "the plant's state is not finite";
  return std::abs(error) > kPi / 2 ? "the angle error passed 90 deg" : "";
}

// The earliest; an event can be logged before the tick it belongs to.
void set_trip(const RunLog& log, double begin_s, Summary& summary) {
  const EventRecord* first = nullptr;
  for (const EventRecord& event : log.events)
    if (is_trip(static_cast<Reason>(event.reason)) && (!first || event.t_ns < first->t_ns))
      first = &event;
  if (!first) return;
  summary.trip = Trip{.reason = first->reason,
                      .role = first->role,
                      .k = first->k,
                      .t_s = std::max(0.0, 1e-9 * static_cast<double>(first->t_ns) - begin_s),
                      .text = first->text};
}

void set_no_hand_over(const Rows& rows, Summary& summary) {
  if (summary.trip || summary.locked || summary.angle_reference == AngleReference::kNone) return;
  if (!rows.all.empty() && is_forced(rows.all.back()))
    summary.lost_why = "no hand-over to the estimate before the end";
}

// The window decides the verdict. The time of a loss is searched in the whole run up to a trip,
// because most losses happen on the start-up ramp.
void set_lock(const Rows& rows, const DriveConfig& config, Summary& summary) {
  bool any = false, lost = false;
  for (const TickRow& row : rows.all) {
    if (summary.trip && row.t_s > rows.all.front().t_s + summary.trip->t_s) break;
    const double error = angle_error(row, summary.angle_reference, config.machine.n_p);
    const std::string why = failed_criterion(row, error);
    const bool in_window = rows.in_window(row);
    any = any || (in_window && (!std::isnan(error) || !why.empty()));
    lost = lost || (in_window && !why.empty());
    // The estimated angle is not judged until the controller uses it.
    const bool forced = row.measurement && row.measurement->mode != Mode::kRun;
    if (why.empty() || summary.lost_at_s || (forced && !in_window)) continue;
    summary.lost_at_s = row.t_s;
    summary.lost_why = why;
  }
  if (any || summary.trip) summary.locked = !lost && !summary.trip;
  if (summary.trip && !summary.lost_at_s) {
    summary.lost_at_s = summary.trip->t_s;
    summary.lost_why = "the drive tripped";
  }
  if (summary.locked.value_or(true)) {
    summary.lost_at_s.reset();
    summary.lost_why.clear();
  }
  set_no_hand_over(rows, summary);
}

void set_speed(const Rows& rows, const DriveConfig& config, Summary& summary) {
  SpeedFigures speed(config.T_s());
  for (std::size_t i = 0; i < rows.all.size(); ++i) {
    speed.note_reference(rows.all[i]);
    if (rows.in_window(rows.all[i])) speed.add(rows.all[i], rows.omega_m[i]);
  }
  speed.write(summary);
  if (summary.trip) summary.speed_held = false;
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
    const bool every_tick =
        row.estimate->status & kGainEveryTick || row.k < config.background_rate().from;
    if (every_tick) summary.n_from_tick.reset();
    if (!every_tick && !summary.n_from_tick && has_background(config.gain.policy))
      summary.n_from_tick = row.k;
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

// Gains sent after tick `first` up to `last`, as the estimates of these ticks tell.
std::int64_t gains_between(const RunLog& log, const DriveConfig& config, std::int64_t first,
                           std::int64_t last) {
  if (!config.locks_first()) return config.gains_between(first, last);
  std::int64_t count = 0, seen = first;
  for (const Estimate& e : log.estimate) {
    if (e.k <= seen || e.k > last) continue;
    seen = e.k;
    count += config.sends_gain(e);
  }
  return count;
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

std::string speed_word(const Summary& summary) {
  if (!summary.locked.value_or(true) || summary.speed_held.value_or(true)) return "";
  const bool dipped = summary.speed_dip_percent.value_or(0) > 100 * kSpeedTolerance;
  return summary.uneven ? "uneven" : dipped ? "dipped" : "overshot";
}

std::string trip_text(const Trip& trip) {
  const char* name = reason_name(trip.reason);
  return fmt::format("{} at {:.4f} s{}, {}: {}", name ? name : fmt::format("{}", trip.reason),
                     trip.t_s, trip.k >= 0 ? fmt::format(", tick {}", trip.k) : "",
                     role_name(trip.role), trip.text);
}

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
  if (!rows.all.empty()) {
    const double begin_s = rows.all.front().t_s;
    summary.window_from_s = std::max(config.run.settle_s, rows.settled_s - begin_s);
    set_trip(log, begin_s, summary);
  }
  set_lock(rows, config, summary);
  set_speed(rows, config, summary);
  set_errors(rows, config, summary);
  set_ripple(rows, summary);
  set_gains(rows, config, summary);
  const auto every_tick = [](std::int64_t first, std::int64_t last) { return last - first; };
  count_lost(log.measurement, every_tick, Channel::kMeasurement, summary);
  count_lost(log.truth, every_tick, Channel::kTruth, summary);
  count_lost(log.estimate, every_tick, Channel::kEstimate, summary);
  count_lost(log.command, every_tick, Channel::kCommand, summary);
  count_lost(
      log.gain, [&](auto first, auto last) { return gains_between(log, config, first, last); },
      Channel::kGain, summary);
  return summary;
}

}  // namespace twinrate

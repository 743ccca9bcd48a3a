#include "analysis/summary_builder.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "analysis/order_spectrum.hpp"
#include "core/reason.hpp"
#include "core/steering.hpp"

namespace twinrate {
namespace {

constexpr double kConstantFor_s = 0.1;  // hold time after which a reference is constant
constexpr double kOffReferenceMax_s = 0.02;
constexpr int kRippleTurnsMin = 3;
constexpr int kRippleOrders = 60;

bool is_forced(const TickRow& row) {
  return row.measurement &&
         (row.measurement->mode == Mode::kAlign || row.measurement->mode == Mode::kIfRamp);
}

// The lock criterion that fails at one tick; "" if none fails.
const char* failed_criterion(const TickRow& row, double error) {
  if (row.estimate && !row.estimate->finite) return "the estimate is not finite";
  if (row.truth && !row.truth->finite) return "the plant's state is not finite";
  return std::abs(error) > kPi / 2 ? "the angle error passed 90 deg" : "";
}

}  // namespace

void RunOutline::Span::add(std::int64_t k) {
  ++count;
  distinct += k != last || count == 1;
  if (count == 1) first = k;
  last = k;
}

void RunOutline::add(const TickRow& row) {
  if (rows++ == 0) {
    begin_s = row.t_s;
    first_k = row.k;
  }
  end_s = row.t_s;
  last_is_forced = is_forced(row);
  // The first command needs plant.delay_samples ticks to act.
  if (was_forced && !last_is_forced && !handed_over_s) handed_over_s = row.t_s;
  was_forced = was_forced || last_is_forced;
  has_position = has_position || (row.measurement && (row.measurement->signals & kPosition));
  uses_position = uses_position || (row.estimate && (row.estimate->status & kMeasuredAngle));
}

AngleReference RunOutline::resolve(AngleReference wanted) const {
  if (has_truth() && (wanted == AngleReference::kAuto || wanted == AngleReference::kTruth))
    return AngleReference::kTruth;
  // The angle of a sensor is no reference for a filter that uses that sensor.
  if (has_position &&
      (wanted == AngleReference::kEncoder || (wanted == AngleReference::kAuto && !uses_position)))
    return AngleReference::kEncoder;
  return AngleReference::kNone;
}

void SpeedFigures::note_reference(const TickRow& row) {
  if (!row.command) return;
  if (!known_ || row.command->omega_m_ref != omega_m_ref_) changed_s_ = row.t_s;
  known_ = true;
  omega_m_ref_ = row.command->omega_m_ref;
}

void SpeedFigures::add(const TickRow& row, double omega_m) {
  const bool constant = known_ && row.t_s - changed_s_ >= kConstantFor_s - T_s_ / 2;
  if (!constant || omega_m_ref_ == 0 || std::isnan(omega_m)) {
    turn_ = {};
    return;
  }
  judged_ = true;
  const double deviation = omega_m / omega_m_ref_ - 1;
  if (std::abs(deviation) > kSpeedTolerance) {
    ++ticks_;
    const int side = deviation < 0 ? -1 : 1;
    if (side != side_) ++sides_;
    side_ = side;
  } else {
    reached_ = true;
  }
  below_ = std::max(below_, -deviation);
  above_ = std::max(above_, deviation);
  if (row.truth)
    add_to_turn(omega_m_ref_ < 0 ? -row.truth->theta_m : row.truth->theta_m,
                std::abs(omega_m_ref_) * (1 + deviation));
}

// Tolerance of half a tick: a total of 20 ms, up to rounding, is not held.
bool SpeedFigures::held() const {
  return static_cast<double>(ticks_) * T_s_ <= kOffReferenceMax_s - T_s_ / 2;
}

void SpeedFigures::write(Summary& summary) {
  if (!judged_) return;
  summary.speed_held = held();
  summary.never_at_reference = !reached_;
  summary.speed_dip_percent = 100 * below_;
  summary.speed_excess_percent = 100 * above_;
  const bool some_turns = static_cast<int>(unevenness_.size()) >= kRippleTurnsMin;
  if (some_turns) {
    const auto middle = unevenness_.begin() + static_cast<std::ptrdiff_t>(unevenness_.size() / 2);
    std::nth_element(unevenness_.begin(), middle, unevenness_.end());
    summary.speed_unevenness_percent = 100 * *middle;
  }
  summary.uneven =
      !held() && (some_turns ? *summary.speed_unevenness_percent > 200 * kSpeedTolerance
                             : sides_ >= kUnevenSides);
}

void SpeedFigures::add_to_turn(double theta_m, double omega_m) {
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

void SummaryBuilder::Squares::add(double value) {
  sum += value * value;
  ++count;
}

std::optional<double> SummaryBuilder::Squares::rms() const {
  if (count == 0) return {};
  return std::sqrt(sum / static_cast<double>(count));
}

SummaryBuilder::SummaryBuilder(const RunLog& head, const RunOutline& outline,
                               const DriveConfig& config, AngleReference wanted)
    : outline_(outline), config_(config), rates_(rate_history(head, config)), speed_(config.T_s()) {
  summary_.angle_reference = outline.resolve(wanted);
  const RunOutline::Span& measured = outline.span(Channel::kMeasurement);
  summary_.steps = measured.count > 0 ? measured.count : outline.rows;
  summary_.duration_s =
      config.T_s() *
      static_cast<double>(measured.count > 0 ? measured.last - measured.first + 1 : outline.rows);
  if (outline.rows == 0) return;
  // Tolerance of 1 ns: t_ns is rounded.
  settled_s_ = outline.begin_s + config.run.settle_s - 1e-9;
  if (outline.was_forced)
    settled_s_ = std::max(settled_s_, outline.handed_over_s.value_or(outline.end_s));
  summary_.window_from_s = std::max(config.run.settle_s, settled_s_ - outline.begin_s);
  set_trip(head);
  summary_.rates_requested = requests_rates(head);
  if (outline.has_truth()) {
    const auto ticks = std::min(static_cast<std::size_t>(outline.rows), kRippleTicks);
    theta_m_.reserve(ticks);
    omega_m_.reserve(ticks);
  }
}

bool SummaryBuilder::in_window(const TickRow& row) const {
  return row.t_s >= settled_s_ && !is_forced(row);
}

// The earliest trip; an event can be logged before the tick to which it belongs. A real drive
// without a COMMAND runs its own control, so the end of a process here is no trip of that drive.
void SummaryBuilder::set_trip(const RunLog& head) {
  const bool listened =
      config_.plant.kind == PlantKind::kBridge && outline_.span(Channel::kCommand).count == 0;
  const EventRecord* first = nullptr;
  for (const EventRecord& event : head.events) {
    const auto reason = static_cast<Reason>(event.reason);
    if (!is_trip(reason) || (listened && is_of_own_set(reason))) continue;
    if (!first || event.t_ns < first->t_ns) first = &event;
  }
  if (!first) return;
  summary_.trip =
      Trip{.reason = first->reason,
           .role = first->role,
           .k = first->k,
           .t_s = std::max(0.0, 1e-9 * static_cast<double>(first->t_ns) - outline_.begin_s),
           .text = first->text};
}

void SummaryBuilder::add(const TickRow& row, double omega_m) {
  const double error = angle_error(row, summary_.angle_reference, config_.machine.n_p);
  judge_lock(row, error);
  speed_.note_reference(row);
  if (in_window(row)) {
    speed_.add(row, omega_m);
    add_errors(row, error, omega_m);
    add_ripple(row);
  }
  add_gain(row);
}

// The verdict counts the ticks of the window. The time of a loss is searched in the whole run up to
// a trip, because most losses occur on the start-up ramp.
void SummaryBuilder::judge_lock(const TickRow& row, double error) {
  if (summary_.trip && row.t_s > outline_.begin_s + summary_.trip->t_s) return;
  const std::string_view why = failed_criterion(row, error);
  const bool within = in_window(row);
  any_ = any_ || (within && (!std::isnan(error) || !why.empty()));
  lost_ = lost_ || (within && !why.empty());
  // The estimated angle is not judged before the controller uses it. The ticks before the first
  // command acts are in mode run.
  const bool not_handed_over = config_.start == Start::kAlignIf && outline_.was_forced &&
                               row.t_s < outline_.handed_over_s.value_or(outline_.end_s);
  const bool forced = not_handed_over || (row.measurement && row.measurement->mode != Mode::kRun);
  if (why.empty() || summary_.lost_at_s || (forced && !within)) return;
  summary_.lost_at_s = row.t_s;
  summary_.lost_why = why;
}

void SummaryBuilder::add_errors(const TickRow& row, double error, double omega_m) {
  if (!row.estimate) return;
  const double speed = row.estimate->omega_m - omega_m;
  if (std::isfinite(error)) {
    angle_errors_.add(error);
    angle_max_ = std::max(angle_max_, std::abs(error));
  }
  if (std::isfinite(speed)) speed_errors_.add(speed);
}

void SummaryBuilder::add_ripple(const TickRow& row) {
  if (!row.truth) return;
  if (theta_m_.size() < kRippleTicks) {
    theta_m_.push_back(row.truth->theta_m);
    omega_m_.push_back(row.truth->omega_m);
    return;
  }
  theta_m_[oldest_] = row.truth->theta_m;
  omega_m_[oldest_] = row.truth->omega_m;
  oldest_ = (oldest_ + 1) % kRippleTicks;
}

void SummaryBuilder::add_gain(const TickRow& row) {
  if (!row.estimate) return;
  const RunOutline::Span& sent = outline_.span(Channel::kGain);
  if (row.k > sent.first && row.k <= sent.last)
    gains_sent_ += rates_.sends_gain(row.k, row.estimate->status);
  if (row.estimate->status & kLateGain) ++summary_.late_gains;
  const bool every_tick =
      row.estimate->status & kGainEveryTick || row.k < config_.background_rate().from;
  if (every_tick) summary_.n_from_tick.reset();
  if (!every_tick && !summary_.n_from_tick && has_background(config_.gain.policy))
    summary_.n_from_tick = row.k;
  if (row.estimate->gain_seq >= 0 && row.estimate->gain_seq != last_gain_) {
    ++summary_.gains_used;
    last_gain_ = row.estimate->gain_seq;
  }
  const bool has_P44 = config_.estimator.kind == "ekf_sensorless";
  if (!has_P44 || !row.gain || !in_window(row)) return;
  const double P44 = row.gain->P44;
  summary_.P44_min = std::min(summary_.P44_min.value_or(P44), P44);
  summary_.P44_max = std::max(summary_.P44_max.value_or(P44), P44);
}

void SummaryBuilder::set_lock() {
  Summary& s = summary_;
  if (any_ || s.trip) s.locked = !lost_ && !s.trip;
  if (s.trip && !s.lost_at_s) {
    s.lost_at_s = s.trip->t_s;
    s.lost_why = "the drive tripped";
  }
  if (s.locked.value_or(true)) {
    s.lost_at_s.reset();
    s.lost_why.clear();
  }
  if (s.locked || s.angle_reference == AngleReference::kNone) return;
  if (outline_.end_s < outline_.begin_s + config_.run.settle_s - 1e-9) {
    s.lost_why = "the run ended before its window, which settle_s begins";
    return;
  }
  if (!outline_.last_is_forced) {
    s.lost_why = "the window has no estimate";
    return;
  }
  s.locked = false;
  s.never_handed_over = true;
  s.lost_why = "no hand-over to the estimate before the end";
}

void SummaryBuilder::set_ripple() {
  const auto in_order = [this](std::vector<double>& ring) {
    std::rotate(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(oldest_), ring.end());
  };
  in_order(theta_m_);
  in_order(omega_m_);
  const OrderSpectrum spectrum = order_spectrum(theta_m_, omega_m_, kRippleOrders);
  if (spectrum.turns < kRippleTurnsMin) return;
  double sum = 0, sum2 = 0;
  for (std::size_t i = spectrum.first; i < spectrum.last; ++i) sum += omega_m_[i];
  const double count = static_cast<double>(spectrum.last - spectrum.first), mean = sum / count;
  for (std::size_t i = spectrum.first; i < spectrum.last; ++i)
    sum2 += (omega_m_[i] - mean) * (omega_m_[i] - mean);
  summary_.speed_ripple_rms = std::sqrt(sum2 / count);
  summary_.speed_ripple_harmonics_rms = spectrum.rms(kRippleOrders);
}

// Messages of each channel lost between its first and last tick.
void SummaryBuilder::set_lost_messages() {
  for (const Channel channel : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                                Channel::kReference, Channel::kCommand, Channel::kGain}) {
    const RunOutline::Span& span = outline_.span(channel);
    if (span.count == 0) continue;
    // A foreign generator need not send a message at every tick.
    if (channel == Channel::kReference && config_.reference.from_bus) continue;
    const std::int64_t expected =
        channel != Channel::kGain ? span.last - span.first
        : config_.locks_first()
            ? gains_sent_
            : rates_.gains_between(span.first, span.last, config_.background_rate());
    summary_.lost_messages[info(channel).name] =
        std::max<std::int64_t>(0, expected + 1 - span.distinct);
  }
}

Summary SummaryBuilder::finish() {
  set_lock();
  speed_.write(summary_);
  if (summary_.trip) summary_.speed_held = false;
  summary_.angle_error_rms = angle_errors_.rms();
  if (summary_.angle_error_rms) summary_.angle_error_max = angle_max_;
  summary_.speed_error_rms = speed_errors_.rms();
  set_ripple();
  set_lost_messages();
  return summary_;
}

}  // namespace twinrate

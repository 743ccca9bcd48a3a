#include "analysis/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/summary_builder.hpp"
#include "core/channels.hpp"
#include "core/reason.hpp"

namespace twinrate {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class Item>
void note(const std::vector<Item>& items, Channel channel, RunOutline& outline) {
  for (const Item& item : items) outline.add(channel, item.k);
}

RunOutline outline_of(const RunLog& log, const std::vector<TickRow>& rows) {
  RunOutline outline;
  for (const TickRow& row : rows) outline.add(row);
  note(log.measurement, Channel::kMeasurement, outline);
  note(log.truth, Channel::kTruth, outline);
  note(log.estimate, Channel::kEstimate, outline);
  note(log.reference, Channel::kReference, outline);
  note(log.command, Channel::kCommand, outline);
  note(log.gain, Channel::kGain, outline);
  return outline;
}

}  // namespace

std::string speed_word(const Summary& summary) {
  if (!summary.locked.value_or(true) || summary.speed_held.value_or(true)) return "";
  const bool dipped = summary.speed_dip_percent.value_or(0) > 100 * kSpeedTolerance;
  const std::string word = summary.uneven ? "uneven" : dipped ? "dipped" : "overshot";
  return word + (summary.never_at_reference ? ", never at its reference" : "");
}

std::string trip_text(const Trip& trip) {
  const char* name = reason_name(trip.reason);
  return fmt::format("{} at {:.4f} s{}, {}: {}", name ? name : fmt::format("{}", trip.reason),
                     trip.t_s, trip.k >= 0 ? fmt::format(", tick {}", trip.k) : "",
                     role_name(trip.role), trip.text);
}

AngleReference resolve(AngleReference wanted, const RunLog& log) {
  RunOutline outline;
  note(log.truth, Channel::kTruth, outline);
  for (const Measurement& m : log.measurement)
    outline.has_position = outline.has_position || (m.signals & kPosition) != 0;
  for (const Estimate& e : log.estimate)
    outline.uses_position = outline.uses_position || (e.status & kMeasuredAngle) != 0;
  return outline.resolve(wanted);
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
  const std::vector<TickRow> rows = tick_rows(log);
  const std::vector<double> omega_m = reference_speed(rows, !log.truth.empty());
  std::vector<TickError> errors;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TickRow& row = rows[i];
    if (!row.estimate || std::isnan(theta_e_reference(row, reference, config.machine.n_p)))
      continue;
    errors.push_back({row.k, row.t_s, angle_error(row, reference, config.machine.n_p),
                      row.estimate->omega_m - omega_m[i], omega_m[i]});
  }
  return errors;
}

Summary summarise(const RunLog& log, const DriveConfig& config, AngleReference angle_reference) {
  const std::vector<TickRow> rows = tick_rows(log);
  const std::vector<double> omega_m = reference_speed(rows, !log.truth.empty());
  SummaryBuilder builder(log, outline_of(log, rows), config, angle_reference);
  for (std::size_t i = 0; i < rows.size(); ++i) builder.add(rows[i], omega_m[i]);
  return builder.finish();
}

}  // namespace twinrate

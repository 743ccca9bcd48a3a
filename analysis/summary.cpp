#include "analysis/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/run_ticks.hpp"
#include "core/channels.hpp"
#include "core/reason.hpp"

namespace twinrate {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

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

std::vector<double> reference_speed(TickRows rows, bool has_truth) {
  std::vector<double> omega_m(rows.size(), kNaN);
  const auto position = [&](std::size_t i) {
    const auto& m = rows[i].measurement;
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
  const RunTicks ticks = run_ticks(log);
  const std::vector<TickRow>& rows = ticks.rows;
  const AngleReference reference = ticks.outline.resolve(angle_reference);
  const std::vector<double> omega_m = reference_speed(rows, ticks.outline.has_truth());
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
  return summarise(log, run_ticks(log), config, angle_reference);
}

Summary summarise(const RunLog& head, const RunTicks& ticks, const DriveConfig& config,
                  AngleReference angle_reference) {
  const std::vector<TickRow>& rows = ticks.rows;
  SummaryBuilder builder(head, ticks.outline, config, angle_reference);
  if (ticks.outline.has_truth()) {
    for (const TickRow& row : rows) builder.add(row, row.truth ? row.truth->omega_m : kNaN);
    return builder.finish();
  }
  const std::vector<double> omega_m = reference_speed(rows, false);
  for (std::size_t i = 0; i < rows.size(); ++i) builder.add(rows[i], omega_m[i]);
  return builder.finish();
}

}  // namespace twinrate

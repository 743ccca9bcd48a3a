#include "analysis/run_ticks.hpp"

namespace twinrate {
namespace {

template <class Item>
void note(const std::vector<Item>& items, Channel channel, RunOutline& outline) {
  for (const Item& item : items) outline.add(channel, item.k);
}

}  // namespace

std::optional<double> RunTicks::measured_from_s() const {
  for (const TickRow& row : rows)
    if (row.measurement) return row.t_s;
  return {};
}

RunTicks run_ticks(const RunLog& log) {
  RunTicks ticks{.rows = tick_rows(log)};
  RunOutline& outline = ticks.outline;
  for (const TickRow& row : ticks.rows) outline.add(row);
  note(log.measurement, Channel::kMeasurement, outline);
  note(log.truth, Channel::kTruth, outline);
  note(log.estimate, Channel::kEstimate, outline);
  note(log.reference, Channel::kReference, outline);
  note(log.command, Channel::kCommand, outline);
  note(log.gain, Channel::kGain, outline);
  return ticks;
}

}  // namespace twinrate

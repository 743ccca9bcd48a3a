#include "trace/position_pictures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <complex>
#include <numeric>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostLogs = 4;  // with pictures; the table of files lists them all
constexpr const char* kHeading = "Residual of each log, before and after";
constexpr const char* kNote =
    "Each row of the log less the model: declared (before), with what was found (after), both less "
    "their means.";

TracePicture empty_picture(const PositionLog& log, const char* what) {
  return {.heading = kHeading,
          .note = kNote,
          .title = fmt::format("{}: {}", log.path, what),
          .x_label = {},
          .y_label = {},
          .x = {},
          .before = {},
          .after = {},
          .held_out = {}};
}

void take_mean(std::vector<double>& y) {
  const double mean =
      std::accumulate(y.begin(), y.end(), 0.0) / std::max(1.0, static_cast<double>(y.size()));
  for (double& value : y) value -= mean;
}

void sort_by_x(TracePicture& p) {
  std::vector<std::size_t> order(p.x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return p.x[i] < p.x[j]; });
  const TracePicture rows = p;
  for (std::size_t i = 0; i < order.size(); ++i) {
    p.x[i] = rows.x[order[i]];
    p.before[i] = rows.before[order[i]];
    p.after[i] = rows.after[order[i]];
    p.held_out[i] = rows.held_out[order[i]];
  }
}

// Rows that hold the rotor, less the model, in the order of the log; x: theta_m in rad.
TracePicture holding_rest(const PositionLog& log, const Found& found) {
  TracePicture p = empty_picture(log, "current that holds the rotor");
  const std::vector<char> ok = holding_rows(log, 5 * found.holding.lag);
  const std::vector<double> held = holding_current(log, found.holding, found.machine);
  for (std::size_t k = 0; k < log.size(); ++k) {
    if (!ok[k]) continue;
    p.x.push_back(log.theta_m[k]);
    p.before.push_back(log.i_q[k]);
    p.after.push_back(log.i_q[k] - held[k]);
    p.held_out.push_back(log.held_out || (!log.judges.empty() && log.judges[k]));
  }
  take_mean(p.before);
  take_mean(p.after);
  p.x_label = "theta_m (deg)";
  p.y_label = "i_q less the model (A)";
  return p;
}

// Amplitude of a whole order over the turns that the rows cover; each row has its angle step as
// weight.
double amplitude_of(int order, const std::vector<double>& theta_m, const std::vector<double>& y) {
  std::complex<double> sum = 0;
  double way = 0;
  for (std::size_t k = 1; k < y.size(); ++k) {
    const double step = std::abs(theta_m[k] - theta_m[k - 1]);
    if (step > kPi) continue;  // a seam
    sum += step * y[k] * std::polar(1.0, -order * theta_m[k]);
    way += step;
  }
  return way > 0 ? 2 * std::abs(sum) / way : 0;
}

TracePicture orders_of(const PositionLog& log, const TracePicture& rest, const Found& found) {
  TracePicture p = empty_picture(log, "orders of the angle");
  for (int order = 1; order <= largest_order(found.machine, rest.x.size()); ++order) {
    p.x.push_back(order);
    p.before.push_back(amplitude_of(order, rest.x, rest.before));
    p.after.push_back(amplitude_of(order, rest.x, rest.after));
    p.held_out.push_back(0);
  }
  p.x_label = "order (periods a turn)";
  p.y_label = "amplitude (A)";
  return p;
}

TracePicture speed_rest(const PositionLog& log, const Found& found, const Judge& judge) {
  TracePicture p = empty_picture(log, "change of the speed");
  const SpeedChangeRows before = speed_change_rows(log, found.declared(), judge.horizon());
  MotionModel model = found.model();
  const Logs& other = judge.other_zero();
  if (std::find(other.begin(), other.end(), &log) != other.end()) model.holding = nullptr;
  const SpeedChangeRows after = speed_change_rows(log, model, judge.horizon());
  if (before.t.size() != after.t.size()) return p;
  p.x = after.t;
  for (std::size_t k = 0; k < after.t.size(); ++k) {
    p.before.push_back(before.measured[k] - before.predicted[k]);
    p.after.push_back(after.measured[k] - after.predicted[k]);
    p.held_out.push_back(log.held_out);
  }
  take_mean(p.before);
  take_mean(p.after);
  p.x_label = "t (s)";
  p.y_label = fmt::format("change over {:.3g} ms less the model (rad/s)", 1e3 * judge.horizon());
  return p;
}

}  // namespace

std::vector<TracePicture> position_pictures(const Found& found, const Judge& judge) {
  std::vector<TracePicture> pictures;
  std::size_t shown = 0;
  for (const PositionLog* log : judge.logs()) {
    if (++shown > kMostLogs) break;
    if (judge.by_speed()) {
      pictures.push_back(speed_rest(*log, found, judge));
      continue;
    }
    TracePicture rest = holding_rest(*log, found);
    const TracePicture orders = orders_of(*log, rest, found);
    for (double& x : rest.x) x = wrap_turn(x) * 180 / kPi;
    sort_by_x(rest);
    pictures.push_back(std::move(rest));
    pictures.push_back(orders);
  }
  return pictures;
}

}  // namespace twinrate

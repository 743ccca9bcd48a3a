#include "report/ripple.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

namespace twinrate::report {
namespace {

constexpr std::size_t kMaxSamples = 400000;  // the fit costs O(samples orders)

double position(const RunView& view, const TickRow& row) {
  return theta_e_reference(row, view.reference, view.n_p()) / view.n_p();
}

struct Window {
  double begin_s, from_s, to_s;
};

// Time of the last change of the reference in (from_s, to_s); from_s without one.
double last_reference_change_s(const RunView& view, double from_s, double to_s) {
  double changed_s = from_s;
  const TickRow::OfCommand* before = nullptr;
  for (const TickRow& row : view.rows) {
    if (row.t_s >= to_s) break;
    if (!row.command) continue;
    if (before && before->omega_m_ref != row.command->omega_m_ref && row.t_s > from_s)
      changed_s = row.t_s;
    before = &*row.command;
  }
  return changed_s;
}

std::vector<Window> windows(const RunView& view) {
  const DriveConfig& config = view.run.config;
  std::vector<double> bounds_s = {view.begin_s()};
  for (const ProfileStep& step : config.controller.compensation.steps())
    if (step.t_s > bounds_s.back() && step.t_s < view.end_s()) bounds_s.push_back(step.t_s);
  bounds_s.push_back(view.end_s());
  std::vector<Window> found;
  for (std::size_t i = 0; i + 1 < bounds_s.size(); ++i) {
    const double to_s = bounds_s[i + 1];
    double constant_s = last_reference_change_s(view, bounds_s[i], to_s);
    for (const ProfileStep& step : config.load.T_load_Nm.steps())
      if (step.t_s < to_s) constant_s = std::max(constant_s, step.t_s);
    const double settle_s = std::min(config.run.settle_s, (to_s - constant_s) / 2);
    found.push_back({bounds_s[i], constant_s + settle_s, to_s});
  }
  return found;
}

// Tolerance of half a tick at both ends; the tick of a switch belongs to the next window.
bool inside(const RunView& view, const Window& window, double t_s) {
  const double half_s = view.run.config.T_s() / 2;
  return t_s > window.from_s - half_s && t_s < window.to_s - half_s;
}

}  // namespace

std::vector<Stretch> ripple_stretches(const RunView& view) {
  const ControllerChoice& controller = view.run.config.controller;
  const std::vector<double> speed = reference_speed(view.rows, view.has_truth());
  std::vector<Stretch> stretches;
  for (const Window& window : windows(view)) {
    std::vector<double> t_s, theta_m, omega_m;
    for (std::vector<double>* column : {&t_s, &theta_m, &omega_m}) column->reserve(speed.size());
    for (std::size_t i = 0; i < view.rows.size(); ++i) {
      if (!inside(view, window, view.rows[i].t_s) || !std::isfinite(speed[i])) continue;
      t_s.push_back(view.rows[i].t_s);
      theta_m.push_back(position(view, view.rows[i]));
      omega_m.push_back(speed[i]);
    }
    Stretch stretch{.begin_s = window.begin_s};
    stretch.spectrum = order_spectrum(theta_m, omega_m, kRippleOrders);
    if (stretch.spectrum.turns == 0) continue;
    const std::span used(omega_m.begin() + static_cast<std::ptrdiff_t>(stretch.spectrum.first),
                         omega_m.begin() + static_cast<std::ptrdiff_t>(stretch.spectrum.last));
    for (const double omega : used) stretch.mean += omega / static_cast<double>(used.size());
    double square = 0;
    for (const double omega : used) square += (omega - stretch.mean) * (omega - stretch.mean);
    stretch.rms = std::sqrt(square / static_cast<double>(used.size()));
    const std::size_t turn = used.size() / static_cast<std::size_t>(stretch.spectrum.turns);
    for (std::size_t i = 0; i < turn; ++i)
      stretch.drift += (used[used.size() - 1 - i] - used[i]) / static_cast<double>(turn);
    stretch.from_s = t_s[stretch.spectrum.first];
    stretch.to_s = t_s[stretch.spectrum.last - 1];
    if (controller.kind == "lqr")
      stretch.compensation =
          kCompensationNames[static_cast<int>(controller.compensation_at(stretch.to_s))];
    stretches.push_back(std::move(stretch));
  }
  return stretches;
}

TorqueOverAngle torque_over_angle(const RunView& view, int N_max) {
  TorqueOverAngle torque;
  if (view.rows.empty()) return torque;
  const Window window = windows(view).back();
  for (const TickRow& row : view.rows) {
    if (row.t_s < window.from_s) continue;
    torque.theta_m.push_back(position(view, row));
    torque.T_load_hat.push_back(quantity::T_load_hat(row));
    torque.T_load.push_back(quantity::T_load_true(row));
  }
  for (std::vector<double>* column : {&torque.theta_m, &torque.T_load_hat, &torque.T_load})
    if (column->size() > kMaxSamples)
      column->erase(column->begin(), column->end() - static_cast<std::ptrdiff_t>(kMaxSamples));
  torque.spectrum = order_spectrum(torque.theta_m, torque.T_load_hat, N_max);
  return torque;
}

std::string change_dB(double before, double after) {
  return before > 0 && after > 0 ? fmt::format("{:+.1f} dB", 20 * std::log10(after / before)) : "-";
}

}  // namespace twinrate::report

// One run: the estimated load over the angle (Niewiara 2020, Fig. 6), and the speed and its ripple
// before and after a change of the compensation (Fig. 7).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/order_sources.hpp"
#include "report/ripple.hpp"

namespace twinrate::report {
namespace {

constexpr int kMaxOrders = 200;
constexpr std::size_t kMaxLabels = 12;
constexpr double kMinRipple_rad_s = 1e-9;  // smaller: rounding

bool is_torque(double T_load) {
  return std::isfinite(T_load) && T_load != 0;
}
bool any_torque(const std::vector<double>& T_load_hat) {
  return std::any_of(T_load_hat.begin(), T_load_hat.end(), is_torque);
}
bool any_torque(const RunView& view) {
  return std::any_of(view.rows.begin(), view.rows.end(),
                     [](const TickRow& row) { return is_torque(quantity::T_load_hat(row)); });
}

Json torque_section(const RunView& view, bool with_figure) {
  Json figures = Json::array();
  if (with_figure) {
    Figure figure{.title = "Load torque", .x_label = "t (s)", .y_label = "T_load (Nm)"};
    figure.draw(view.rows, {{"T_load", "true", quantity::T_load_true},
                            {"T_load_hat", "hat", quantity::T_load_hat}});
    figure.group = "run";
    figures.push_back(to_json(figure));
  }
  return {{"heading", "Load torque"},
          {"note", "T_load opposes positive speed; the estimate includes friction and cogging."},
          {"columns", 1},
          {"figures", std::move(figures)}};
}

// The samples of the last turn over their angles.
Figure angle_figure(const TorqueOverAngle& torque) {
  Figure figure{.title = "(a) Load torque over the last turn",
                .x_label = "angle of the rotor (deg)",
                .y_label = "T_load (Nm)"};
  std::vector<std::size_t> order;
  const double end = torque.theta_m[torque.spectrum.last - 1];
  for (std::size_t i = torque.spectrum.first; i < torque.spectrum.last; ++i)
    if (std::abs(end - torque.theta_m[i]) < kTwoPi) order.push_back(i);
  const auto angle = [&](std::size_t i) { return wrap_turn(torque.theta_m[i]); };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return angle(i) < angle(j); });
  std::vector<double> T_load, T_load_hat;
  for (const std::size_t i : order) {
    figure.x.push_back(angle(i) * kDegrees);
    T_load.push_back(torque.T_load[i]);
    T_load_hat.push_back(torque.T_load_hat[i]);
  }
  figure.add({"T_load", "true", T_load});
  figure.add({"T_load_hat", "hat", T_load_hat});
  figure.note =
      "T_load is the mechanical load alone; errors of current and voltage act on the estimate, "
      "too.";
  return figure;
}

// Number of orders to show: 60, or up to the last order of at least 5 % of the largest.
int shown_orders(const OrderSpectrum& spectrum) {
  const auto& amplitude = spectrum.amplitude;
  const double largest = *std::max_element(amplitude.begin(), amplitude.end());
  std::size_t shown = std::min<std::size_t>(kRippleOrders, amplitude.size());
  for (std::size_t i = shown; i < amplitude.size(); ++i)
    if (amplitude[i] > 0.05 * largest) shown = std::min(amplitude.size(), i + 4);
  return static_cast<int>(shown);
}

double amplitude_of(const OrderSpectrum& spectrum, int N) {
  return spectrum.amplitude[static_cast<std::size_t>(N - 1)];
}

std::vector<OrderSource> sources_of(const RunView& view, int N) {
  return order_sources(N, view.n_p(), view.run.config.machine.n_slots);
}

Figure spectrum_figure(const RunView& view, const OrderSpectrum& spectrum, int shown) {
  Figure figure{.title = "(b) Orders of the load-torque estimate",
                .x_label = "order (periods a turn)",
                .y_label = "amplitude (Nm)"};
  figure.bars = true;
  for (int N = 1; N <= shown; ++N) figure.x.push_back(N);
  figure.add(
      {"T_load_hat", "hat", {spectrum.amplitude.begin(), spectrum.amplitude.begin() + shown}});
  const double level = kDetectionRatio * spectrum.noise(shown);
  const double largest = *std::max_element(spectrum.amplitude.begin(), spectrum.amplitude.end());
  figure.level = {{level, ""}};
  std::vector<int> largest_orders;
  for (int N = 1; N <= shown; ++N)
    if (amplitude_of(spectrum, N) > std::max(level, 0.05 * largest)) largest_orders.push_back(N);
  std::stable_sort(largest_orders.begin(), largest_orders.end(), [&](int N, int M) {
    return amplitude_of(spectrum, N) > amplitude_of(spectrum, M);
  });
  if (largest_orders.size() > kMaxLabels) largest_orders.resize(kMaxLabels);
  for (const int N : largest_orders)
    figure.bar_labels.push_back({N, fmt::format("{} {}", N, label(sources_of(view, N)))});
  figure.note = fmt::format(
      "Over {} whole turns; mean {:.4g} Nm, orders 1 to {} together {:.3g} Nm rms. The line is "
      "{:g} "
      "times the median order, {:.2g} Nm: white noise exceeds it at one order of 65,000. The steps "
      "of an encoder, and noise that is not white, can do so, too.",
      spectrum.turns, spectrum.mean, shown, spectrum.rms(shown), kDetectionRatio, level);
  return figure;
}

// Every detected order, and the fundamental of every source.
Json source_table(const RunView& view, const OrderSpectrum& spectrum, int shown) {
  Json rows = Json::array();
  const double level = kDetectionRatio * spectrum.noise(shown);
  for (int N = 1; N <= shown; ++N) {
    const std::vector<OrderSource> sources = sources_of(view, N);
    const bool stands_out = amplitude_of(spectrum, N) > level;
    const bool fundamental = std::any_of(sources.begin(), sources.end(),
                                         [](const OrderSource& s) { return s.multiple == 1; });
    if (!stands_out && !fundamental) continue;
    const std::string text = describe(sources);
    rows.push_back(
        {std::to_string(N), fmt::format("{:.3g}", 1e3 * amplitude_of(spectrum, N)),
         text.empty() ? "none in motor or inverter: load, coupling, side band, or chance" : text,
         stands_out ? "yes" : "no"});
  }
  return {{"head", {"order", "amplitude, mNm", "sources", "above noise"}}, {"rows", rows}};
}

Json torque_angle_section(const RunView& view) {
  const TorqueOverAngle torque = torque_over_angle(view, kMaxOrders);
  if (torque.spectrum.turns == 0 || !any_torque(torque.T_load_hat)) return Json();
  const int shown = shown_orders(torque.spectrum);
  return {{"heading", "Load torque over the angle, and its sources"},
          {"note", fmt::format("Orders count periods a mechanical turn, of {} pole pairs and {} "
                               "slots. See docs/ripple-reduction.md.",
                               view.n_p(),
                               view.run.config.machine.n_slots > 0
                                   ? std::to_string(view.run.config.machine.n_slots)
                                   : "an unknown number of")},
          {"columns", 1},
          {"figures",
           {to_json(angle_figure(torque)), to_json(spectrum_figure(view, torque.spectrum, shown))}},
          {"table", source_table(view, torque.spectrum, shown)}};
}

Json stretch_table(const std::vector<Stretch>& stretches) {
  Json rows = Json::array();
  const Stretch& first = stretches.front();
  for (const Stretch& s : stretches) {
    const double orders = s.spectrum.rms(kRippleOrders);
    const bool reference = &s == &first;
    rows.push_back({s.compensation.empty() ? "-" : s.compensation,
                    fmt::format("{:.3f} .. {:.3f}", s.from_s, s.to_s),
                    std::to_string(s.spectrum.turns), fmt::format("{:.5g}", s.mean),
                    fmt::format("{:.4g}", s.rms), reference ? "" : change_dB(first.rms, s.rms),
                    fmt::format("{:.4g}", orders),
                    reference ? "" : change_dB(first.spectrum.rms(kRippleOrders), orders),
                    fmt::format("{:+.3g}", s.drift)});
  }
  return {{"head",
           {"compensation", "t, s", "turns", "mean, rad/s", "ripple rms, rad/s", "change",
            "orders 1-60, rad/s", "change", "drift, rad/s"}},
          {"rows", rows}};
}

Json ripple_section(const RunView& view, const std::vector<Stretch>& stretches) {
  Figure figure = speed_figure(view, view.between(stretches.front().from_s, view.end_s()));
  figure.title = "Speed";
  figure.group = "ripple";
  for (std::size_t i = 1; i < stretches.size(); ++i)
    figure.marks.push_back({stretches[i].begin_s, "compensation " + stretches[i].compensation});
  return {{"heading", "Speed ripple"},
          {"note",
           "True speed less its mean, over the last whole turns of each stretch in which "
           "compensation, reference and load are constant. Drift: the mean of the last turn less "
           "that of the first. It is no ripple, but it is in the rms value and in the orders."},
          {"columns", 1},
          {"figures", {to_json(figure)}},
          {"table", stretch_table(stretches)}};
}

Json speed_orders_section(const std::vector<Stretch>& stretches) {
  double largest = 0;
  for (const Stretch& s : stretches)
    for (const double amplitude : s.spectrum.amplitude) largest = std::max(largest, amplitude);
  Json figures = Json::array();
  for (const Stretch& s : stretches) {
    Figure figure{.title = s.compensation.empty() ? "Speed" : "Compensation " + s.compensation,
                  .x_label = "order (periods a turn)",
                  .y_label = "amplitude (rad/s)"};
    figure.bars = true;
    for (std::size_t N = 1; N <= s.spectrum.amplitude.size(); ++N)
      figure.x.push_back(static_cast<double>(N));
    figure.add({"omega_m", "hat", s.spectrum.amplitude});
    figure.y_range = {{0, 1.15 * largest}};
    figure.note = fmt::format("{} whole turns, {:.4g} rad/s rms, drift {:+.3g} rad/s.",
                              s.spectrum.turns, s.rms, s.drift);
    figures.push_back(to_json(figure));
  }
  return {{"heading", "Orders of the speed"},
          {"note", "All on one scale."},
          {"columns", stretches.size() > 1 ? 2 : 1},
          {"figures", std::move(figures)}};
}

}  // namespace

std::vector<Json> ripple_sections(const RunView& view) {
  const bool with_torque = any_torque(view);
  std::vector<Json> sections = {torque_section(view, with_torque)};
  if (with_torque) sections.push_back(torque_angle_section(view));
  if (view.lost() || view.rows.empty()) return sections;
  const std::vector<Stretch> stretches = ripple_stretches(view);
  const bool any_ripple = std::any_of(stretches.begin(), stretches.end(),
                                      [](const Stretch& s) { return s.rms > kMinRipple_rad_s; });
  if (!any_ripple) return sections;
  sections.push_back(ripple_section(view, stretches));
  sections.push_back(speed_orders_section(stretches));
  return sections;
}

}  // namespace twinrate::report

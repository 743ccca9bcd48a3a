#include "report/trace_plots.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model/effects/tracing.hpp"
#include "model/frames.hpp"

namespace twinrate::report {
namespace {

constexpr double kMiddle = 0.99;      // share of the rows on the axis: outliers do not stretch it
constexpr double kMinDivisor = 0.15;  // of the largest speed or current
constexpr int kPeriodBins = 60;

Points points_of(const Rows& rows) {
  Points p;
  p.e = rows.view.without;
  p.share = rows.view.share;
  p.held_out = rows.s.held_out;
  p.g.assign(rows.size(), 1.0);
  return p;
}

template <class Of>
std::vector<double> each(std::size_t count, Of&& of) {
  std::vector<double> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = of(i);
  return values;
}

// Drops rows with a small divisor.
void keep_large(Points& p) {
  double largest = 0;
  for (const double g : p.g) largest = std::max(largest, std::abs(g));
  Points kept;
  for (std::size_t i = 0; i < p.x.size(); ++i) {
    if (std::abs(p.g[i]) < kMinDivisor * largest) continue;
    kept.x.push_back(p.x[i]), kept.e.push_back(p.e[i]), kept.share.push_back(p.share[i]);
    kept.g.push_back(p.g[i]), kept.held_out.push_back(p.held_out[i]);
  }
  p = std::move(kept);
}

Plot over(const Rows& rows, std::string title, std::string x_label, std::vector<double> x) {
  Plot plot{.points = points_of(rows), .title = std::move(title), .x_label = std::move(x_label)};
  plot.y_label = fmt::format("{} ({})", rows.words.name, rows.words.unit);
  plot.points.x = std::move(x);
  std::tie(plot.lo, plot.hi) = middle(plot.points.x, kMiddle);
  return plot;
}

Plot over_period(const Rows& rows, double order) {
  Plot plot = over(
      rows, order == 1 ? "Over one turn" : fmt::format("Over one period, {:.4g} a turn", order),
      "angle of the rotor in the period (deg)", each(rows.size(), [&](std::size_t i) {
        return wrap_turn(order * rows.s.theta_m[i]) / order * kDegrees;
      }));
  plot.lo = 0, plot.hi = 360 / order, plot.bins = kPeriodBins;
  return plot;
}

Plot over_cycle(const Rows& rows, double f_Hz) {
  Plot plot = over(rows, fmt::format("Over one period of {:.5g} Hz", f_Hz),
                   "time in the period (ms)", each(rows.size(), [&](std::size_t i) {
                     return wrap_turn(kTwoPi * f_Hz * rows.s.t[i]) / kTwoPi / f_Hz * 1e3;
                   }));
  plot.lo = 0, plot.hi = 1e3 / f_Hz, plot.bins = kPeriodBins;
  return plot;
}

Plot over_speed(const Rows& rows) {
  return over(rows, "Over the speed", "omega_m (rad/s)", rows.s.omega_m);
}

// Missing flux linkage from the rotational voltage: e_d = -omega_e psi_q, e_q = omega_e psi_d.
Plot flux_over(const Rows& rows, std::string x_label, std::vector<double> x) {
  const bool d = rows.view.channel == "d";
  const std::string flux = d ? "psi_q" : "psi_d";
  const std::string title = fmt::format("Missing {} over {}", flux, x_label.substr(0, 3));
  Plot plot = over(rows, title, std::move(x_label), std::move(x));
  plot.y_label = fmt::format("missing {} (mWb)", flux);
  plot.note = fmt::format("{} over the electrical speed, fast rows only.", rows.words.name);
  const double sign = d ? -1e-3 : 1e-3;
  plot.points.g =
      each(rows.size(), [&](std::size_t i) { return sign * rows.n_p * rows.s.omega_m[i]; });
  keep_large(plot.points);
  return plot;
}

Plot resistance_over_time(const Rows& rows) {
  const bool d = rows.view.channel == "d";
  Plot plot = over(rows, "Over time", "t (s)", rows.s.t);
  plot.y_label = "missing resistance (Ohm)";
  plot.note = fmt::format("{} over {}, rows with a large current only.", rows.words.name,
                          d ? "i_d" : "i_q");
  plot.points.g = d ? rows.s.i_d : rows.s.i_q;
  keep_large(plot.points);
  return plot;
}

// Voltage error of each phase over its current, the three phases pooled.
Plot over_phase_current(const TraceResult& r, const TracedEffect& effect, int n_p) {
  const EffectView *d = nullptr, *q = nullptr;
  for (const EffectView& view : effect.views) {
    if (view.channel == "d") d = &view;
    if (view.channel == "q") q = &view;
  }
  Plot plot{.points = {}, .title = "Over the phase current", .x_label = "current of the phase (A)"};
  plot.y_label = "voltage of the phase (V)";
  plot.note = "The three phases together.";
  if (!d || !q) return plot;
  const TraceSeries& s = r.series_q;
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    const double theta_e = n_p * s.theta_m[i];
    const auto phases = [&](double x_d, double x_q) {
      return inverse_clarke(inverse_park(Vec2(x_d, x_q), theta_e));
    };
    const Vec3 current = phases(s.i_d[i], s.i_q[i]), e = phases(d->without[i], q->without[i]),
               share = phases(d->share[i], q->share[i]);
    for (int phase = 0; phase < 3; ++phase) {
      plot.points.x.push_back(current[phase]);
      plot.points.e.push_back(e[phase]);
      plot.points.share.push_back(share[phase]);
      plot.points.g.push_back(1);
      plot.points.held_out.push_back(s.held_out[i]);
    }
  }
  std::tie(plot.lo, plot.hi) = middle(plot.points.x, kMiddle);
  return plot;
}

double value_of(const TracedEffect& e, const char* key) {
  const std::string name = split_unit(key).name;
  for (const TracedParameter& p : e.parameters)
    if (p.name == name) return p.value;
  return 0;
}

Plot over_period_of(const TracedEffect& effect, const Rows& rows, std::size_t half) {
  const Traits::Period period = effect.effect->tracing().traits().period;
  const double order = *period.order_key ? value_of(effect, period.order_key) : period.order;
  if (order > 0) return over_period(rows, order);
  return *period.frequency_key ? over_cycle(rows, value_of(effect, period.frequency_key))
                               : over_share(rows, half);
}

// Times the sign of the speed.
Plot over_period_by_motion(const TracedEffect& effect, const Rows& rows, std::size_t half) {
  Plot plot = over_period_of(effect, rows, half);
  plot.note = "Against the motion: torque times the sign of the speed.";
  plot.points.g =
      each(rows.size(), [&](std::size_t i) { return rows.s.omega_m[i] < 0 ? -1.0 : 1.0; });
  return plot;
}

}  // namespace

Plot over_share(const Rows& rows, std::size_t half) {
  Plot plot = over(rows, "Against what the effect predicts",
                   fmt::format("the effect's {} ({})", rows.words.name, rows.words.unit),
                   smooth(rows.view.share, rows.s.t, rows.s.rate_Hz, half));
  plot.points.e = smooth(rows.view.without, rows.s.t, rows.s.rate_Hz, half);
  plot.points.share = plot.points.x;
  plot.note = "If the effect is present, the points lie on the line of slope one.";
  return plot;
}

Plot plot_of(const TraceResult& r, const TracedEffect& effect, const Rows& rows, std::size_t half) {
  using View = Traits::View;
  const View view = effect.effect->tracing().traits().view;
  const TraceSeries& s = rows.s;
  const bool torque = rows.view.channel == "torque", d = rows.view.channel == "d";
  if (torque != (view >= View::kTorqueOverPeriod)) return over_share(rows, half);
  switch (view) {
    case View::kPhaseVoltageOverCurrent:
      return over_phase_current(r, effect, rows.n_p);
    case View::kResistanceOverTime:
      return resistance_over_time(rows);
    case View::kFluxOverItsCurrent:
      return d ? flux_over(rows, "i_q (A)", s.i_q) : flux_over(rows, "i_d (A)", s.i_d);
    case View::kFluxOverOtherCurrent:
      return d ? flux_over(rows, "i_d (A)", s.i_d) : flux_over(rows, "i_q (A)", s.i_q);
    case View::kVoltageOverSpeed:
    case View::kTorqueOverSpeed:
      return over_speed(rows);
    case View::kTorqueOverPeriod:
      return over_period_of(effect, rows, half);
    case View::kTorqueOverPeriodByMotion:
      return over_period_by_motion(effect, rows, half);
    case View::kTorqueOverTime:
      return over(rows, "Over time", "t (s)", s.t);
    default:
      return over_share(rows, half);
  }
}

}  // namespace twinrate::report

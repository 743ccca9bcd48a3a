#include "bench/blind/drawn_visible.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <limits>

namespace twinrate::blind {
namespace {

constexpr double kHeldOut = 0.25;    // share of the rows
constexpr double kDeviations = 3.1;  // p < 0.001, one-sided
constexpr int kOrder = 8;            // of the autoregression
constexpr std::size_t kFewest = 60;  // windows; fewer do not determine the autoregression

using Series = std::vector<double>;
using Equations3 = std::array<Series, 3>;  // d, q, torque; empty: not in the log

// Values of a row for the equations.
struct Row {
  Vec2 i_dq = Vec2::Zero(), u_alphabeta = Vec2::Zero();
  double theta_m = 0, T_load = 0;  // theta_m not wrapped
};

std::vector<Row> rows_of(const DrawnCase& c, const std::vector<Tick>& ticks, int every) {
  const MachineParameters& m = c.drawn.machine;
  const double half_count = c.drawn.encoder_counts > 0 ? kTwoPi / c.drawn.encoder_counts / 2 : 0;
  std::vector<Row> rows;
  for (std::size_t k = 0; k < ticks.size(); k += static_cast<std::size_t>(every)) {
    const double theta_m = ticks[k].theta_m + half_count;
    const double before = rows.empty() ? theta_m : rows.back().theta_m;
    Row row{.theta_m = before + wrap_pi(theta_m - before), .T_load = ticks[k].T_load};
    row.i_dq = park(clarke(ticks[k].i_abc), m.n_p * row.theta_m);
    if (c.mode == "angle_current") row.i_dq[0] = 0;
    row.u_alphabeta = every > 1 ? row_voltage(c, ticks, k) : ticks[k].u_alphabeta;
    rows.push_back(row);
  }
  return rows;
}

// Residual of the voltage equations over the interval from row a to row b.
Vec2 left_of_voltage(const MachineParameters& m, const Row& a, const Row& b, double T) {
  const double omega_e = m.n_p * (b.theta_m - a.theta_m) / T;
  const Vec2 u = park(a.u_alphabeta, 0.5 * m.n_p * (a.theta_m + b.theta_m));
  const Vec2 i = 0.5 * (a.i_dq + b.i_dq), slope = (b.i_dq - a.i_dq) / T;
  return {u[0] - m.R_s * i[0] - m.L_d * slope[0] + omega_e * m.L_q * i[1],
          u[1] - m.R_s * i[1] - m.L_q * slope[1] - omega_e * (m.L_d * i[0] + m.psi_f)};
}

Equations3 equations(const DrawnCase& c, const std::vector<Row>& rows, double T) {
  const MachineParameters& m = c.drawn.machine;
  const bool voltage = c.mode == "full" || c.mode == "decimated";
  Equations3 e;
  std::vector<double> inner;  // accelerating torque of a row
  inner.reserve(rows.size());
  for (const Row& r : rows) inner.push_back(m.torque(r.i_dq[0], r.i_dq[1]) - r.T_load);
  for (std::size_t k = 1; k + 1 < rows.size(); ++k) {
    const double before = rows[k - 1].theta_m, here = rows[k].theta_m, after = rows[k + 1].theta_m;
    e[2].push_back((inner[k - 1] + 4 * inner[k] + inner[k + 1]) / 6 -
                   m.B * (after - before) / (2 * T) - m.J * (after - 2 * here + before) / (T * T));
    if (!voltage) continue;
    const Vec2 left = left_of_voltage(m, rows[k], rows[k + 1], T);
    e[0].push_back(left[0]), e[1].push_back(left[1]);
  }
  return e;
}

// Means of h values, applied twice to a torque, which comes from a second difference.
Series windows(const Series& x, std::size_t h, bool twice) {
  if (h == 1) return x;
  const auto means = [h](const Series& y) {
    Series z;
    double sum = 0;
    for (std::size_t k = 0; k < y.size(); ++k) {
      sum += y[k] - (k >= h ? y[k - h] : 0);
      if (k + 1 >= h) z.push_back(sum / static_cast<double>(h));
    }
    return z;
  };
  const Series smooth = twice ? means(means(x)) : means(x);
  Series every;
  for (std::size_t k = 0; k < smooth.size(); k += h) every.push_back(smooth[k]);
  return every;
}

// Autoregression of noise, and the standard deviation of its innovation.
struct Whitening {
  Eigen::VectorXd taps = Eigen::VectorXd::Zero(kOrder);
  double sigma = 1;
};
Whitening whitening_of(const Series& n) {
  Eigen::VectorXd r = Eigen::VectorXd::Zero(kOrder + 1);
  for (std::size_t lag = 0; lag <= kOrder; ++lag)
    for (std::size_t k = lag; k < n.size(); ++k)
      r[static_cast<Eigen::Index>(lag)] += n[k] * n[k - lag] / static_cast<double>(n.size());
  Eigen::MatrixXd R(kOrder, kOrder);
  for (int i = 0; i < kOrder; ++i)
    for (int j = 0; j < kOrder; ++j) R(i, j) = r[std::abs(i - j)] * (i == j ? 1 + 1e-9 : 1);
  Whitening w;
  w.taps = R.ldlt().solve(r.tail(kOrder));
  w.sigma = std::sqrt(std::max(r[0] - w.taps.dot(r.tail(kOrder)), 1e-12 * r[0]));
  return w;
}

void append_whitened(const Whitening& w, const Series& x, std::size_t size, Series& out) {
  for (std::size_t k = 0; k < size; ++k) {
    double e = k < x.size() ? x[k] : 0;
    for (std::size_t j = 1; j <= std::min<std::size_t>(kOrder, k) && k - j < x.size(); ++j)
      e -= w.taps[static_cast<Eigen::Index>(j - 1)] * x[k - j];
    out.push_back(w.sigma > 0 ? e / w.sigma : 0);
  }
}

// Each effect of `c` in windows of h rows, whitened by the noise `n`, with the equations one after
// another.
std::vector<Eigen::VectorXd> over_noise(const std::vector<Equations3>& c, const Equations3& n,
                                        std::size_t h) {
  std::vector<Eigen::VectorXd> all;
  for (const Equations3& one : c) {
    Series whole;
    for (std::size_t channel = 0; channel < 3; ++channel) {
      const Series noise = windows(n[channel], h, channel == 2);
      if (noise.size() < kFewest) continue;
      append_whitened(whitening_of(noise), windows(one[channel], h, channel == 2), noise.size(),
                      whole);
    }
    all.emplace_back(
        Eigen::Map<Eigen::VectorXd>(whole.data(), static_cast<Eigen::Index>(whole.size())));
  }
  return all;
}

// |c| of each effect on the held-out rows, without the part that the larger effects explain.
std::vector<double> sizes_of(std::vector<Eigen::VectorXd> c) {
  std::vector<double> sizes(c.size(), 0);
  std::vector<char> done(c.size(), 0);
  for (std::size_t round = 0; round < c.size(); ++round) {
    std::size_t best = 0;
    double largest = -1;
    for (std::size_t j = 0; j < c.size(); ++j)
      if (!done[j] && c[j].norm() > largest) best = j, largest = c[j].norm();
    done[best] = 1, sizes[best] = std::sqrt(kHeldOut) * largest;
    if (largest <= 0) continue;
    const Eigen::VectorXd direction = c[best] / largest;
    for (std::size_t j = 0; j < c.size(); ++j)
      if (!done[j]) c[j] -= direction.dot(c[j]) * direction;
  }
  return sizes;
}

bool on_converter(const std::string& kind) {
  return kind.starts_with("adc_");
}
bool on_samples(const std::string& kind) {
  return on_converter(kind) || kind.ends_with("_samples");
}

// The run with these effects alone; `exact`: without noise, steps and counts.
std::vector<Tick> run_with(DrawnCase c, const std::string& effects_toml, bool exact) {
  c.effects_toml = effects_toml;
  c.kinds.clear();
  if (exact) {
    c.drawn.encoder_counts = 0;
    c.drawn.angle_noise = c.drawn.i_lsb = c.drawn.i_noise = c.drawn.v_dc_noise = 0;
  }
  return simulate(c);
}

// Residuals of the run without noise, averaged over rows.
Equations3 left_in_run(DrawnCase c, const std::string& effect_toml) {
  const std::vector<Tick> ticks = run_with(c, effect_toml, true);
  c.drawn.encoder_counts = 0;
  Equations3 e = equations(c, rows_of(c, ticks, 1), 1 / c.drawn.f_s);
  for (std::size_t channel = 0; channel < 3; ++channel)
    e[channel] = windows(e[channel], static_cast<std::size_t>(c.every), channel == 2);
  return e;
}

Equations3 less(Equations3 a, const Equations3& b) {
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (std::size_t k = 0; k < a[channel].size(); ++k) a[channel][k] -= b[channel][k];
  return a;
}

}  // namespace

Deviations deviations_in_log(const DrawnCase& c, const std::vector<std::string>& truth) {
  if (truth.empty()) return {};
  std::vector<std::string> asked;
  std::vector<Equations3> effects;
  const Equations3 of_equations = left_in_run(c, "");  // error of their discretisation
  for (std::size_t j = 0; j < c.kinds.size(); ++j) {
    if (on_samples(c.kinds[j])) continue;
    asked.push_back(c.kinds[j]);
    effects.push_back(less(left_in_run(c, c.effect_tables[j]), of_equations));
  }
  const Equations3 noise =
      equations(c, rows_of(c, run_with(c, "", false), c.every), c.every / c.drawn.f_s);
  Deviations deviations;
  for (std::size_t h = 1; noise[2].size() / h >= kFewest; h *= 2) {
    const std::vector<double> sizes = sizes_of(over_noise(effects, noise, h));
    for (std::size_t j = 0; j < sizes.size(); ++j)
      deviations[asked[j]] = std::max(deviations[asked[j]], sizes[j] / 2);
  }
  for (const std::string& kind : truth)
    // i_q alone does not show the steps and the limit of the phase currents.
    if (on_samples(kind))
      deviations[kind] = on_converter(kind) && c.mode == "angle_current"
                             ? 0
                             : std::numeric_limits<double>::infinity();
  return deviations;
}

std::vector<std::string> visible_kinds(const Deviations& deviations,
                                       const std::vector<std::string>& truth) {
  std::vector<std::string> visible;
  for (const std::string& kind : truth)
    if (deviations.at(kind) > kDeviations) visible.push_back(kind);
  return visible;
}

}  // namespace twinrate::blind

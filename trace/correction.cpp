#include "trace/correction.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr int kKnots = 25, kTurnKnots = 36;
constexpr double kEdge = 0.005;  // of the rows beyond the outer knots, each side
constexpr double kStiff = 1e-3;  // of a knot's mean weight: couples knots without rows

const TraceSeries& series_of(const TraceResult& r, const std::string& channel) {
  return channel == "d" ? r.series_d : channel == "q" ? r.series_q : r.series_torque;
}

// Knots on both sides of x and the weight of the upper one.
struct Place {
  std::size_t lower = 0, upper = 0;
  double weight = 0;
};

Place place_of(const CorrectionTable& c, double x) {
  const std::size_t n = c.x.size();
  if (c.periodic) {
    const double u = wrap_turn(x) / kTwoPi * static_cast<double>(n);
    const auto k = std::min(static_cast<std::size_t>(u), n - 1);
    return {k, (k + 1) % n, u - static_cast<double>(k)};
  }
  if (x <= c.x.front()) return {0, 0, 0};
  if (x >= c.x.back()) return {n - 1, n - 1, 0};
  const auto k =
      static_cast<std::size_t>(std::upper_bound(c.x.begin(), c.x.end(), x) - c.x.begin() - 1);
  return {k, k + 1, (x - c.x[k]) / (c.x[k + 1] - c.x[k])};
}

bool place_knots(const TraceSeries& s, CorrectionTable& c) {
  if (c.periodic) {
    for (int k = 0; k < kTurnKnots; ++k) c.x.push_back(kTwoPi * k / kTurnKnots);
    return true;
  }
  if (c.regressor == "direction") {
    c.x = {-1, 1};
    return true;
  }
  std::vector<double> x;
  for (std::size_t i = 0; i < s.t.size(); ++i)
    if (!s.held_out[i]) x.push_back(regressor_at(s, i, c));
  std::sort(x.begin(), x.end());
  if (x.empty()) return false;
  const auto edge = static_cast<std::size_t>(kEdge * static_cast<double>(x.size()));
  const double lo = x[edge], hi = x[x.size() - 1 - edge];
  if (!(hi > lo)) return false;
  for (int k = 0; k < kKnots; ++k) c.x.push_back(lo + (hi - lo) * k / (kKnots - 1));
  return true;
}

void fit(const TraceSeries& s, CorrectionTable& c) {
  const auto n = static_cast<Eigen::Index>(c.x.size());
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    if (s.held_out[i]) continue;
    const Place p = place_of(c, regressor_at(s, i, c));
    const auto l = static_cast<Eigen::Index>(p.lower), u = static_cast<Eigen::Index>(p.upper);
    const double low = 1 - p.weight, up = p.weight;
    A(l, l) += low * low, A(u, u) += up * up;
    A(l, u) += low * up, A(u, l) += low * up;
    b[l] += low * s.after[i], b[u] += up * s.after[i];
  }
  const double stiff = kStiff * A.trace() / static_cast<double>(n) + 1e-12;
  for (Eigen::Index k = 0; k + 1 < n; ++k) {
    A(k, k) += stiff, A(k + 1, k + 1) += stiff;
    A(k, k + 1) -= stiff, A(k + 1, k) -= stiff;
  }
  A.diagonal().array() += 1e-6 * stiff;
  const Eigen::VectorXd value = A.ldlt().solve(b);
  c.value.assign(value.data(), value.data() + n);
}

void measure(const TraceSeries& s, CorrectionTable& c) {
  double before[2] = {0, 0}, after[2] = {0, 0}, rows[2] = {0, 0};
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    const int k = s.held_out[i] ? 1 : 0;
    const double rest = s.after[i] - c.at(regressor_at(s, i, c));
    before[k] += s.after[i] * s.after[i], after[k] += rest * rest, ++rows[k];
  }
  const auto rms = [&](double sum, int k) { return rows[k] > 0 ? std::sqrt(sum / rows[k]) : 0; };
  c.before = {rms(before[0], 0), rms(before[1], 1)};
  c.after = {rms(after[0], 0), rms(after[1], 1)};
}

}  // namespace

double CorrectionTable::at(double regressor_value) const {
  if (value.empty()) return 0;
  const Place p = place_of(*this, regressor_value);
  return (1 - p.weight) * value[p.lower] + p.weight * value[p.upper];
}

double regressor_at(const TraceSeries& s, std::size_t i, const CorrectionTable& c) {
  if (c.regressor == "theta_m") return wrap_turn(s.theta_m[i]);
  if (c.regressor == "omega_m") return s.omega_m[i];
  if (c.regressor == "i_d") return s.i_d[i];
  if (c.regressor == "i_q") return s.i_q[i];
  return s.omega_m[i] > 0 ? 1 : -1;
}

std::vector<CorrectionTable> corrections_of(const TraceResult& r) {
  std::vector<CorrectionTable> list;
  for (const Structure& structure : r.unexplained) {
    if (structure.regressor == "t" || structure.frequency_Hz > 0 || structure.order > 0) continue;
    if (structure.channel.empty()) continue;
    CorrectionTable c{.regressor = structure.regressor, .channel = structure.channel};
    c.periodic = c.regressor == "theta_m";
    const TraceSeries& s = series_of(r, c.channel);
    if (s.t.empty() || !place_knots(s, c)) continue;
    fit(s, c);
    measure(s, c);
    list.push_back(std::move(c));
  }
  return list;
}

}  // namespace twinrate

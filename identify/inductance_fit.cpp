#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "identify/found.hpp"

namespace twinrate {
namespace {

constexpr double kLeastFall = 0.02, kSigmas = 3;

// x f(x): the flux in units of L I_s, and its slope (model/effects/saturation.cpp).
double flux(int form, double x) {
  constexpr double kEnd = 0.8, kTop = kEnd / (1 + kEnd * kEnd);
  constexpr double kSlope = (1 - kEnd * kEnd) / ((1 + kEnd * kEnd) * (1 + kEnd * kEnd));
  if (form == 0) return x / (1 + x);
  if (form == 1) return x < kEnd ? x / (1 + x * x) : kTop + kSlope * (x - kEnd);
  return std::tanh(x);
}
double share(const InductancePoint& p, int form, double I_s) {
  const double x = std::abs(p.i) / I_s, a = std::max(0.0, x - 1e-4), b = x + 1e-4;
  if (p.small) return (flux(form, b) - flux(form, a)) / (b - a);
  return x > 0 ? flux(form, x) / x : 1;
}

struct Weighted {
  double L = 0, sigma = 0, misfit = 0;
};
template <class Share>
Weighted weighted_fit(const std::vector<InductancePoint>& points, Share share_of) {
  double ss = 0, sy = 0;
  for (const InductancePoint& p : points) {
    const double s = share_of(p), w = 1 / (p.L.sigma * p.L.sigma);
    ss += w * s * s, sy += w * s * p.L.value;
  }
  Weighted fit{sy / ss, 1 / std::sqrt(ss), 0};
  for (const InductancePoint& p : points)
    fit.misfit += std::pow((p.L.value - fit.L * share_of(p)) / p.L.sigma, 2);
  return fit;
}

// Relative error of L at zero current, which is extrapolated from sines of finite amplitude; from
// five drawn drives.
constexpr double kExtrapolated = 3e-3;
constexpr int kForms[] = {0, 1, 2};

InductanceFit fit_with(const std::vector<InductancePoint>& points, std::span<const int> forms) {
  const auto constant = weighted_fit(points, [](const InductancePoint&) { return 1.0; });
  const auto n = static_cast<double>(points.size());
  const auto scatter = [&](const Weighted& fit, double parameters) {
    return fit.sigma * std::sqrt(std::max(1.0, fit.misfit / std::max(1.0, n - parameters)));
  };
  InductanceFit result{{constant.L, scatter(constant, 1)}, {}, constant.misfit};
  if (points.size() < 3) return result;
  const auto [least, most] = std::minmax_element(
      points.begin(), points.end(),
      [](const auto& a, const auto& b) { return std::abs(a.i) < std::abs(b.i); });
  const double fall = least->L.value - most->L.value;
  if (fall < kLeastFall * least->L.value ||
      fall < kSigmas * std::hypot(least->L.sigma, most->L.sigma))
    return result;
  Weighted best{0, 0, constant.misfit};
  std::vector<Weighted> fits;
  for (const int form : forms) {
    for (double I_s = 0.2 * std::abs(most->i); I_s < 50 * std::abs(most->i); I_s *= 1.02) {
      fits.push_back(weighted_fit(points, [&](const auto& p) { return share(p, form, I_s); }));
      if (fits.back().misfit >= best.misfit) continue;
      best = fits.back();
      result.saturation = {form, I_s};
    }
  }
  if (!result.saturation) return result;
  result.L = {best.L, std::hypot(scatter(best, 2), kExtrapolated * best.L)};
  result.misfit = best.misfit;
  // Other forms and scales that fit the points about as well give another L at zero current: the
  // largest difference is part of sigma.
  const double unit = std::max(1.0, best.misfit / std::max(1.0, n - 2));
  for (const Weighted& fit : fits)
    if (fit.misfit < best.misfit + unit)
      result.L.sigma = std::max(result.L.sigma, std::abs(fit.L - best.L));
  return result;
}

}  // namespace

InductanceFit fit_inductance(const std::vector<InductancePoint>& points) {
  return fit_with(points, kForms);
}

InductanceFits fit_inductances(const std::vector<InductancePoint>& d,
                               const std::vector<InductancePoint>& q) {
  const InductanceFits alone{fit_inductance(d), fit_inductance(q)};
  const bool both = alone.d.saturation && alone.q.saturation;
  if (!both || alone.d.saturation->form == alone.q.saturation->form) return alone;
  InductanceFits best = alone;
  double least = INFINITY;
  for (const int& form : kForms) {
    const InductanceFits fits{fit_with(d, {&form, 1}), fit_with(q, {&form, 1})};
    if (!fits.d.saturation || !fits.q.saturation) continue;
    if (fits.d.misfit + fits.q.misfit >= least) continue;
    least = fits.d.misfit + fits.q.misfit;
    best = fits;
  }
  // The difference to the fit of one axis alone is part of the error of L.
  best.d.L.sigma =
      std::max({best.d.L.sigma, alone.d.L.sigma, std::abs(best.d.L.value - alone.d.L.value)});
  best.q.L.sigma =
      std::max({best.q.L.sigma, alone.q.L.sigma, std::abs(best.q.L.value - alone.q.L.value)});
  return best;
}

}  // namespace twinrate

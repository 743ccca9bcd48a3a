#include "trace/rest.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

constexpr int kBins = 24;
constexpr double kChance = 1e-9;      // of noise making such means
constexpr double kLeastShare = 0.04;  // of the residual's power: less is too small to draw

struct Axis {
  const char* regressor;
  std::function<double(const OperatingPoint&)> of;
  bool periodic_turn = false;
};

// Means over bins of equal count; 0 share where noise would do it too.
double explained_share(const Eigen::VectorXd& e, const std::vector<double>& x) {
  const std::size_t n = x.size();
  std::vector<double> edges = x;
  std::sort(edges.begin(), edges.end());
  std::vector<double> limits;
  for (int b = 1; b < kBins; ++b) {
    const double limit = edges[n * static_cast<std::size_t>(b) / kBins];
    if (limits.empty() || limit > limits.back()) limits.push_back(limit);
  }
  if (limits.size() < 1) return 0;
  std::vector<double> sum(limits.size() + 1, 0.0), count = sum;
  for (std::size_t i = 0; i < n; ++i) {
    const auto b = static_cast<std::size_t>(std::upper_bound(limits.begin(), limits.end(), x[i]) -
                                            limits.begin());
    sum[b] += e[static_cast<Eigen::Index>(i)];
    ++count[b];
  }
  double explained = 0;
  for (std::size_t b = 0; b < sum.size(); ++b)
    if (count[b] > 0) explained += sum[b] * sum[b] / count[b];
  const double total = e.squaredNorm();
  const double chi = explained / (total / static_cast<double>(n));
  if (chi_square_tail(chi, static_cast<double>(sum.size())) > kChance) return 0;
  return explained / total;
}

}  // namespace

std::vector<Structure> structure_of_rest(const Fitter& fitter, const Fit& fit) {
  std::vector<Structure> found;
  const Chain& chain = fitter.chain();
  const auto& points = chain.equations().points();
  const Axis axes[] = {
      {"t", [](const OperatingPoint& p) { return p.t; }},
      {"theta_m", [](const OperatingPoint& p) { return wrap_turn(p.theta_m); }},
      {"i_d", [](const OperatingPoint& p) { return p.i_dq[0]; }},
      {"i_q", [](const OperatingPoint& p) { return p.i_dq[1]; }},
      {"omega_m", [](const OperatingPoint& p) { return p.omega_m; }},
      {"direction", [](const OperatingPoint& p) { return p.omega_m > 0 ? 1.0 : -1.0; }},
  };
  const auto look = [&](const Eigen::VectorXd& e, const Runs& runs, const char* equation,
                        const char* what, const char* channel) {
    if (e.size() < 50 * kBins) return;
    Structure best;
    for (const Axis& axis : axes) {
      std::vector<double> x;
      for (std::size_t row : runs.row) x.push_back(axis.of(points[row]));
      const double share = explained_share(e, x);
      if (share < kLeastShare || share <= best.share) continue;
      best = {
          .regressor = axis.regressor, .share = share, .equation = equation, .channel = channel};
      best.text = fmt::format("{} depends on {} ({:.1f} % of its power)", what, axis.regressor,
                              100 * share);
    }
    if (best.share > 0) found.push_back(best);
  };
  if (fit.y.d.size()) {
    look(fit.y.d, chain.sampler().electrical(), "electrical", "the rest of the d voltage", "d");
    look(fit.y.q, chain.sampler().electrical(), "electrical", "the rest of the q voltage", "q");
  }
  look(fit.y.torque, chain.sampler().torque(), "mechanical", "the rest of the torque", "torque");
  return found;
}

Structure line_structure(const Effect& effect, const Selected& selected) {
  const double f = get_key(effect, "frequency_Hz"), order = get_key(effect, "order");
  Structure s{.regressor = f > 0 ? "t" : "theta_m",
              .share = selected.held_out_gain,
              .equation = "mechanical",
              .channel = "torque"};
  s.frequency_Hz = f;
  s.order = order;
  const double A = get_key(effect, "amplitude_Nm");
  s.text = f > 0 ? fmt::format("a torque of {:.3g} Nm at {:.4g} Hz in time", A, f)
                 : fmt::format("a torque of {:.3g} Nm of order {:.4g} in the angle", A, order);
  return s;
}

std::string what_separates(const std::vector<std::string>& kinds) {
  const auto has = [&](const char* kind) {
    return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
  };
  if (has("dead_time") && has("inverter_drop"))
    return "runs at two bus voltages: dead time's loss is in proportion to v_dc, a device's drop "
           "is not";
  if (has("current_offset") && has("inverter_offset"))
    return "a run at standstill without voltage: only the sensor's offset stays";
  if (has("resistance") && has("voltage_gain"))
    return "a faster run without load: there the voltage is mostly EMF";
  if (has("flux_linkage") && (has("current_gain") || has("encoder_offset") || has("voltage_gain")))
    return "a run with load steps at several speeds and with i_d of both signs";
  if (has("inertia") || has("torsion") || has("backlash"))
    return "a run with fast speed reversals and one with a slow ramp";
  if (has("cogging") || has("current_gain") || has("friction_ripple") || has("eccentric_load") ||
      has("flux_harmonics") || has("encoder_eccentricity"))
    return "slow runs in both directions, with and without load";
  if (has("viscous_friction") || has("coulomb_friction") || has("stribeck_friction") ||
      has("fan_load") || has("constant_load") || has("iron_loss"))
    return "constant speeds from standstill to rated speed in both directions";
  return "a run that varies speed, load and i_d independently (twinrate trace --plan)";
}

}  // namespace twinrate

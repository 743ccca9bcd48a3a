#include "trace/residual_structure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "model/effects/materiality.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

constexpr int kBins = 24;
constexpr double kSmallestVoltage = 2e-4;   // of the bus voltage, rms of the means
constexpr double kChance = 1e-9;            // of noise making such means
constexpr double kLeastBesideShaft = 0.15;  // impacts are never met to the last bit
constexpr double kTimesNoise = 2;           // the rms of a rest that is more than noise
constexpr double kLeastShare = 0.04;        // of the residual's power: less is too small to draw

// What moves little more than its own noise in most rows orders nothing: that noise is in the rest,
// too. The start of a run at constant load moves i_q by far more than noise does, but only the few
// rows of the start. By the quarters of the rows, which are 1.35 deviations of noise apart.
bool moves(const std::vector<double>& x, const std::vector<double>& noisier) {
  constexpr double kTimes = 5, kQuarters = 1.349;
  std::vector<double> sorted = x;
  std::sort(sorted.begin(), sorted.end());
  double noise = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    noise += (noisier[i] - x[i]) * (noisier[i] - x[i]) / static_cast<double>(x.size());
  const double apart = sorted[x.size() * 3 / 4] - sorted[x.size() / 4];
  return apart > kTimes * kQuarters * std::sqrt(noise);
}

struct Axis {
  const char* regressor;
  std::function<double(const OperatingPoint&)> of;
  bool periodic_turn = false;
};

// Means over bins of equal count; 0 share where noise would do it too. `size`: rms of the same
// means of `physical`.
double explained_share(const Eigen::VectorXd& e, const Eigen::VectorXd& physical,
                       const std::vector<double>& x, double& size) {
  const std::size_t n = x.size();
  std::vector<double> edges = x;
  std::sort(edges.begin(), edges.end());
  std::vector<double> limits;
  for (int b = 1; b < kBins; ++b) {
    const double limit = edges[n * static_cast<std::size_t>(b) / kBins];
    if (limits.empty() || limit > limits.back()) limits.push_back(limit);
  }
  if (limits.size() < 1) return 0;
  std::vector<double> sum(limits.size() + 1, 0.0), count = sum, sum_physical = sum;
  for (std::size_t i = 0; i < n; ++i) {
    const auto b = static_cast<std::size_t>(std::upper_bound(limits.begin(), limits.end(), x[i]) -
                                            limits.begin());
    sum[b] += e[static_cast<Eigen::Index>(i)];
    sum_physical[b] += physical[static_cast<Eigen::Index>(i)];
    ++count[b];
  }
  double explained = 0, power = 0;
  for (std::size_t b = 0; b < sum.size(); ++b) {
    if (count[b] == 0) continue;
    explained += sum[b] * sum[b] / count[b];
    power += sum_physical[b] * sum_physical[b] / count[b];
  }
  size = std::sqrt(power / static_cast<double>(n));
  const double total = e.squaredNorm();
  const double chi = explained / (total / static_cast<double>(n));
  if (chi_square_tail(chi, static_cast<double>(sum.size())) > kChance) return 0;
  return explained / total;
}

}  // namespace

std::vector<Structure> residual_structure(const Fitter& fitter, const Fit& fit) {
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
  const Sampled physical = chain.residual(fit.effects());
  const double least = (has_shaft(fit.members) ? kLeastBesideShaft : kLeastShare) +
                       fit.doubt / std::max(1e-300, fit.raw_held_out);
  const auto look = [&](const Eigen::VectorXd& e, const Eigen::VectorXd& e_physical,
                        const Runs& runs, const char* equation, const char* what,
                        const char* channel, double smallest) {
    if (e.size() < 50 * kBins) return;
    Structure best;
    for (const Axis& axis : axes) {
      std::vector<double> x, noisier;
      for (std::size_t row : runs.row) {
        x.push_back(axis.of(points[row]));
        noisier.push_back(axis.of(chain.readings().points()[row]));
      }
      if (!moves(x, noisier)) continue;
      double size = 0;
      const double share = explained_share(e, e_physical, x, size);
      if (share < least || share <= best.share || size < smallest) continue;
      best = {
          .regressor = axis.regressor, .share = share, .equation = equation, .channel = channel};
      best.text = fmt::format("{} depends on {} ({:.1f} % of its power)", what, axis.regressor,
                              100 * share);
    }
    if (best.share > 0) found.push_back(best);
  };
  // What acts now and then (impacts, a load that comes and goes) depends on none of these.
  const auto bursts_of_torque = [&] {
    const Eigen::VectorXd& e = physical.torque;
    const double rms = std::sqrt(e.squaredNorm() / std::max(1.0, static_cast<double>(e.size())));
    const double noise = chain.noise().torque.rms();
    if (rms <= kTimesNoise * noise) return;
    found.push_back({.regressor = "t",
                     .share = 1 - noise * noise / (rms * rms),
                     .equation = "mechanical",
                     .channel = "torque",
                     .bursts = true});
    found.back().text = fmt::format(
        "the torque residual comes in bursts ({:.3g} Nm rms, noise {:.3g} Nm)", rms, noise);
  };
  const DriveFacts& facts = chain.equations().facts();
  const double smallest_V = kSmallestVoltage * facts.v_dc;
  if (fit.y.d.size()) {
    const Runs& runs = chain.sampler().electrical();
    look(fit.y.d, physical.d, runs, "electrical", "the residual of the d voltage", "d", smallest_V);
    look(fit.y.q, physical.q, runs, "electrical", "the residual of the q voltage", "q", smallest_V);
  }
  look(fit.y.torque, physical.torque, chain.sampler().torque(), "mechanical",
       "the residual of the torque", "torque", smallest_torque(facts, 6e-3));
  if (std::none_of(fit.members.begin(), fit.members.end(),
                   [](const auto& member) { return has_gap(*member); }))
    bursts_of_torque();
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

namespace {

using Run = Traits::Run;

const char* text_of(Run run) {
  switch (run) {
    case Run::kTwoBusVoltages:
      return "runs at two bus voltages: dead time's loss is in proportion to v_dc, a device's drop "
             "is not";
    case Run::kUncoupled:
      return "the same run with the load taken off the shaft";
    case Run::kWindingAlone:
      return "the winding's resistance measured at its terminals";
    case Run::kStandstillWithoutVoltage:
      return "a run at standstill without voltage: only the offset of the sensor remains";
    case Run::kFastWithoutLoad:
      return "a faster run without load: there the voltage is mostly EMF";
    case Run::kLoadStepsAndCurrents:
      return "a run with load steps at several speeds and with i_d of both signs";
    case Run::kReversals:
      return "a run with fast speed reversals and one with a slow ramp";
    case Run::kSlowBothWays:
      return "slow runs in both directions, with and without load";
    case Run::kConstantSpeeds:
      return "constant speeds from standstill to rated speed in both directions";
    default:
      return "a run that varies speed, load and i_d independently";
  }
}

// The first of the runs that the kinds themselves and, two by two, their relatives name.
Run run_that_separates(const std::vector<std::string>& kinds) {
  Run first = Run::kVaried;
  const auto may = [&](Run run) {
    const bool of_two_alone = run == Run::kUncoupled || run == Run::kWindingAlone;
    if (!of_two_alone || kinds.size() == 2) first = std::min(first, run);
  };
  for (const std::string& kind : kinds) {
    const Traits traits = make_effect(kind)->tracing().traits();
    may(traits.told_by);
    for (const Traits::Relative& relative : traits.relatives)
      if (std::count(kinds.begin(), kinds.end(), relative.kind)) may(relative.run);
  }
  return first;
}

bool is_beyond_a_run(Run run) {
  return run <= Run::kWindingAlone;
}

}  // namespace

std::string beyond_a_run(const std::vector<std::string>& kinds) {
  const Run run = run_that_separates(kinds);
  return is_beyond_a_run(run) ? text_of(run) : "";
}

std::string what_separates(const std::vector<std::string>& kinds) {
  const Run run = run_that_separates(kinds);
  const char* proposal = is_beyond_a_run(run) ? "" : " (twinrate trace --plan proposes one)";
  return std::string(text_of(run)) + proposal;
}

}  // namespace twinrate

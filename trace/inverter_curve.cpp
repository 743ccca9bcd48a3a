#include <algorithm>
#include <array>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/static_sets.hpp"
#include "trace/static_split.hpp"

namespace twinrate {
namespace {

constexpr std::array<const char*, 3> kCurrents{"i_a", "i_b", "i_c"};
constexpr std::array<const char*, 3> kVoltages{"u_a", "u_b", "u_c"};

int phase_of(const StaticSet& set) {
  for (int phase = 0; phase < 3; ++phase)
    if (set.has(kCurrents[static_cast<std::size_t>(phase)]) &&
        set.has(kVoltages[static_cast<std::size_t>(phase)]))
      return phase;
  return -1;
}

}  // namespace

StaticKind kind_of(const StaticSet& set) {
  if (set.has("i_d") && set.has("i_q") && set.has("psi_d") && set.has("psi_q"))
    return StaticKind::kFluxMap;
  if (phase_of(set) >= 0) return StaticKind::kInverterCurve;
  return set.has("theta_m") && set.has("i_q") ? StaticKind::kHoldingCurrent : StaticKind::kNone;
}

StaticTrace trace_inverter_curve(const StaticSet& set, const DriveFacts& facts,
                                 const std::vector<char>& held_out, const TraceHooks& hooks,
                                 const Considered& considered) {
  const int phase = phase_of(set);
  const auto& i = set.at(kCurrents[static_cast<std::size_t>(phase)]);
  const auto& u = set.at(kVoltages[static_cast<std::size_t>(phase)]);
  StaticTrace trace;
  trace.considered = considered;
  StaticProblem& p = trace.problem;
  p.facts = facts;
  p.hooks = hooks;
  p.channels = {kVoltages[static_cast<std::size_t>(phase)]};
  p.y.resize(static_cast<Eigen::Index>(set.size()), 1);
  // The d axis is on the axis of the phase, so i_d is its current.
  const double axis = kTwoPi * phase / 3;
  for (std::size_t k = 0; k < set.size(); ++k) {
    p.points.push_back({.i_dq = Vec2(i[k], 0), .v_dc = facts.v_dc, .theta_e = axis});
    p.y(static_cast<Eigen::Index>(k), 0) = u[k] - facts.machine.R_s * i[k];
  }
  p.observe = [](const Contribution& c, const OperatingPoint&) {
    return Eigen::RowVectorXd::Constant(1, c.u_dq_drop[0]);
  };
  p.scale = Eigen::RowVectorXd::Ones(1);
  p.readings = {u};
  trace.held_out_rule = split_points(
      set, i, {}, held_out,
      "every fourth point in the order of the current; another fourth made the selection", p);
  double i_max = 0;
  for (const double value : i) i_max = std::max(i_max, std::abs(value));
  // As for inverter_drop and resistance.
  p.smallest = {std::max(1e-3 * facts.v_dc, 0.02 * facts.machine.R_s * i_max)};
  std::vector<StaticTerm> drops;
  for (int shape = 0; shape < 4; ++shape) {
    StaticTerm drop{
        make_effect("inverter_drop"), {"threshold_V"}, {{"linear_current_A", 1e-3 * i_max, i_max}}};
    set_key(*drop.effect, "shape", shape);
    drops.push_back(std::move(drop));
  }
  trace.selection = select_static(
      p, considered_terms(considered, {{make_effect("resistance"), {"change_Ohm"}, {}}}),
      considered_terms(considered, std::move(drops)));
  return trace;
}

std::shared_ptr<Effect> equivalent_dead_time(const Effect& drop, const DriveFacts& facts) {
  const double threshold_V = get_key(drop, "threshold_V");
  if (threshold_V < 0 || facts.v_dc <= 0 || facts.f_pwm <= 0) return nullptr;
  const OtherName dead_time =
      read_as(drop, *reading_of(drop, Traits::Reading::kItsThreshold), facts);
  return dead_time.fits && dead_time.effect->prepare(facts).empty() ? dead_time.effect : nullptr;
}

}  // namespace twinrate

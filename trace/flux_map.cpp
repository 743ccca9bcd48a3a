#include <algorithm>
#include <cmath>

#include "model/effects/traced.hpp"
#include "trace/keys.hpp"
#include "trace/static_sets.hpp"
#include "trace/static_split.hpp"

namespace twinrate {
namespace {

constexpr double kSmallestFlux = 0.006;  // of the rated flux: as of flux_linkage

double largest(const std::vector<double>& values) {
  double most = 0;
  for (const double value : values) most = std::max(most, std::abs(value));
  return most;
}

std::shared_ptr<Effect> with_choice(const char* kind, const char* key, int position) {
  auto effect = make_effect(kind);
  set_key(*effect, key, position);
  return effect;
}

// Scales are searched from 3 % of the largest current to three times it.
SearchedKey scale(const char* key, double i_max) {
  return {key, 0.03 * i_max, 3 * i_max};
}

std::vector<StaticTerm> saturations(double i_d_max, double i_q_max) {
  std::vector<StaticTerm> all;
  for (int form = 0; form < 3; ++form) {
    all.push_back(
        {with_choice("saturation", "form", form), {"share_q"}, {scale("current_q_A", i_q_max)}});
    all.push_back({with_choice("saturation", "form", form),
                   {"share_q", "share_d"},
                   {scale("current_q_A", i_q_max), scale("current_d_A", i_d_max)}});
  }
  for (const bool second : {false, true})
    for (const bool fades : {false, true}) {
      StaticTerm term{make_effect("cross_saturation"), {"coefficient_H_A"}, {}};
      if (second) term.linear.push_back("second_H_A2");
      if (fades) term.searched.push_back(scale("current_A", i_q_max));
      all.push_back(std::move(term));
    }
  return all;
}

// True if more current makes more flux along its own axis, up to twice the currents of the map.
bool flux_rises(const Effects& effects, const MachineParameters& m, double i_d_max,
                double i_q_max) {
  const auto psi = [&](double i_d, double i_q) {
    return Vec2(sum_at(effects, {.i_dq = Vec2(i_d, i_q)}).psi_dq + Vec2(m.L_d * i_d, m.L_q * i_q));
  };
  constexpr int kSteps = 20;
  for (int k = -kSteps; k < kSteps; ++k) {
    const double d = 2 * i_d_max * k / kSteps, d_next = 2 * i_d_max * (k + 1) / kSteps;
    const double q = 2 * i_q_max * k / kSteps, q_next = 2 * i_q_max * (k + 1) / kSteps;
    if (psi(d_next, 0)[0] <= psi(d, 0)[0] || psi(0, q_next)[1] <= psi(0, q)[1]) return false;
  }
  return true;
}

}  // namespace

StaticTrace trace_flux_map(const StaticSet& set, const DriveFacts& facts,
                           const std::vector<char>& held_out, const TraceHooks& hooks,
                           const Considered& considered) {
  const auto &i_d = set.at("i_d"), &i_q = set.at("i_q");
  const auto &psi_d = set.at("psi_d"), &psi_q = set.at("psi_q");
  StaticTrace trace;
  trace.considered = considered;
  StaticProblem& p = trace.problem;
  p.facts = facts;
  p.hooks = hooks;
  p.channels = {"psi_d", "psi_q"};
  p.y.resize(static_cast<Eigen::Index>(set.size()), 2);
  const MachineParameters& m = facts.machine;
  for (std::size_t k = 0; k < set.size(); ++k) {
    p.points.push_back({.i_dq = Vec2(i_d[k], i_q[k]), .v_dc = facts.v_dc});
    p.y.row(static_cast<Eigen::Index>(k)) << psi_d[k] - m.L_d * i_d[k] - m.psi_f,
        psi_q[k] - m.L_q * i_q[k];
  }
  p.observe = [](const Contribution& c, const OperatingPoint&) {
    return Eigen::RowVectorXd(c.psi_dq.transpose());
  };
  p.readings = {psi_d, psi_q};
  trace.held_out_rule = split_points(set, i_d, i_q, held_out,
                                     "every fourth point of the grid of i_d and i_q, as on a chess "
                                     "board; another fourth made the selection",
                                     p);
  const double i_d_max = largest(i_d), i_q_max = largest(i_q);
  p.possible = [m, i_d_max, i_q_max](const Effects& effects) {
    return flux_rises(effects, m, i_d_max, i_q_max);
  };
  p.scale = Eigen::RowVectorXd::Ones(2);
  const std::vector<StaticTerm> constants =
      considered_terms(considered, {{make_effect("flux_linkage"), {"change_Wb"}, {}},
                                    {make_effect("inductance"), {"change_d_H", "change_q_H"}, {}}});
  const StaticFit constant = fit_static(p, constants);
  p.scale = constant.train.cwiseMax(1e-12);
  const double smallest = kSmallestFlux * std::hypot(m.psi_f, m.L_q * rated_current(facts));
  p.smallest = {smallest, smallest};
  trace.selection =
      select_static(p, constants, considered_terms(considered, saturations(i_d_max, i_q_max)));
  return trace;
}

}  // namespace twinrate

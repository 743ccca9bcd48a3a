// Sets without time: their kinds by the columns of a measured file, and the trace of each.
//
//   flux map         i_d, i_q, psi_d, psi_q            psi - (L_d i_d + psi_f, L_q i_q)
//   inverter curve   a phase current and its voltage   u - R i at standstill
//   holding current  theta_m, i_q                      trace/holding_torque.hpp
#pragma once
#include <map>
#include <string>
#include <vector>

#include "trace/considered.hpp"
#include "trace/static_selection.hpp"

namespace twinrate {

// A measured file without time: columns by canonical name, all of one length.
struct StaticSet {
  std::string path;
  std::map<std::string, std::vector<double>> columns;
  std::vector<std::string> files;  // paths of several files; `file`: index for each row
  std::vector<int> file;

  std::size_t size() const { return columns.empty() ? 0 : columns.begin()->second.size(); }
  bool has(const std::string& name) const { return columns.count(name) != 0; }
  const std::vector<double>& at(const std::string& name) const { return columns.at(name); }
};

enum class StaticKind { kNone, kFluxMap, kInverterCurve, kHoldingCurrent };
StaticKind kind_of(const StaticSet& set);

struct StaticTrace {
  StaticProblem problem;
  StaticSelection selection;
  std::string held_out_rule;  // rule of the held-out points, in words
  Considered considered;
};

// `held_out`: of each point, whether it judges; empty: the rule of trace/static_split.hpp.
//
// Flux map: constants (flux_linkage, inductance), then saturation and cross_saturation. Errors are
// weighted by those of the constant model, so that both axes count.
StaticTrace trace_flux_map(const StaticSet& set, const DriveFacts& facts,
                           const std::vector<char>& held_out = {}, const TraceHooks& hooks = {},
                           const Considered& considered = {});
// Inverter curve: the resistance, then the drop of the switches in each of its shapes. Half the
// current returns through each of the other two phases of the star. Dead time of the same shape is
// the same curve at one bus voltage: equivalent_dead_time() gives that alias.
StaticTrace trace_inverter_curve(const StaticSet& set, const DriveFacts& facts,
                                 const std::vector<char>& held_out = {},
                                 const TraceHooks& hooks = {}, const Considered& considered = {});
// The dead_time with the same loss as `drop` at every current, resistance aside. Null if the drive
// has no bus voltage or switching frequency.
std::shared_ptr<Effect> equivalent_dead_time(const Effect& drop, const DriveFacts& facts);

}  // namespace twinrate

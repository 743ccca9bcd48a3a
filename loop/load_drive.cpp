#include "loop/load_drive.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "controller/controller.hpp"
#include "core/bridge_parameters.hpp"
#include "core/bus_parameters.hpp"
#include "core/config_write.hpp"
#include "core/logger_parameters.hpp"
#include "core/realtime_parameters.hpp"
#include "core/steering.hpp"
#include "estimator/registry.hpp"
#include "loop/lcm_replay.hpp"
#include "monitor/monitor_parameters.hpp"
#include "plant_sim/plant_parameters.hpp"
#include "plant_sim/safety_parameters.hpp"

namespace twinrate {
namespace {

// `owner`: "estimator" or "controller"; `make_builder`: kind -> builder with its keys.
template <class MakeBuilder>
void read_kinds(Config& config, const std::string& owner, const std::string& chosen,
                const std::vector<std::string>& kinds, MakeBuilder make_builder) {
  if (std::find(kinds.begin(), kinds.end(), chosen) == kinds.end())
    throw BadInput(fmt::format("{}: {}.kind: one of {} allowed, found {}",
                               config.where(owner + ".kind"), owner, fmt::join(kinds, ", "),
                               chosen));
  for (const std::string& kind : kinds) {
    const std::string path = fmt::format("{}.{}", owner, kind);
    if (kind != chosen && !config.has_table(path)) continue;
    const auto builder = make_builder(kind, config.drive());
    config.read_table(path, [&](FieldVisitor& f) { builder->fields(f); });
  }
}

}  // namespace

std::vector<OwnedTable> owned_tables() {
  return {owned_table<PlantParameters>(),    owned_table<SafetyParameters>(),
          owned_table<BusParameters>(),      owned_table<LoggerParameters>(),
          owned_table<MonitorParameters>(),  owned_table<BridgeParameters>(),
          owned_table<SteeringParameters>(), owned_table<RealtimeParameters>()};
}

void read_all_tables(Config& config) {
  for (const OwnedTable& table : owned_tables()) config.read_table(table.path, table.fields);
  const DriveConfig& drive = config.drive();
  const auto filter = [](const std::string& kind, const DriveConfig& d) {
    return filter_builder(kind, d);
  };
  const auto controller = [](const std::string& kind, const DriveConfig& d) {
    return controller_builder(kind, d);
  };
  read_kinds(config, "estimator", drive.estimator.kind, filter_kinds(), filter);
  read_kinds(config, "controller", drive.controller.kind, controller_kinds(), controller);
  config.require_all_read();
}

// A run that was stopped may end within a tick.
std::int64_t whole_ticks(const RunLog& log) {
  return log.command.empty() ? 0 : log.command.back().k + 1;
}

namespace {

std::string written(const ConfiguredEffect& effect) {
  DriveConfig only;
  only.effects = {effect};
  return write_effects(only);
}

// The effects of the drive file and the added ones, each with the time in which the model had it. A
// change at tick k is half a period before it, so that rounding does not move it.
std::vector<ConfiguredEffect> steered_effects(const RunLog& log, const DriveConfig& drive) {
  std::vector<ConfiguredEffect> effects = drive.effects;
  const std::size_t declared = effects.size();
  for (const ModelChange& change : model_changes_in(log)) {
    const double t_s = (static_cast<double>(change.k) - 0.5) * drive.T_s();
    for (ConfiguredEffect e : Config::effects_in(change.effects, log.path)) {
      if (change.add) {
        if (e.used_in == UsedIn::kPlant) continue;
        e.used_in = UsedIn::kModel;
        e.known_from_s = t_s;
        effects.push_back(e);
        continue;
      }
      e.used_in = UsedIn::kModel;
      for (std::size_t i = declared; i < effects.size(); ++i) {
        e.known_from_s = effects[i].known_from_s;
        if (written(effects[i]) != written(e)) continue;
        effects[i].known_to_s = t_s;
        break;
      }
    }
  }
  return effects;
}

}  // namespace

std::string steered_drive_file(const RunLog& log, bool with_effects) {
  Config config = Config::parse(log.config_toml, log.path + " (DRIVE_MANIFEST)");
  read_all_tables(config);
  std::vector<std::string> overrides = steered_overrides(config, log, whole_ticks(log));
  if (with_effects)
    overrides.emplace_back("monitor.enabled=false");  // the effects that it added are in the file
  Config steered = Config::parse(config.resolved(), log.path, overrides);
  read_all_tables(steered);
  if (!with_effects) return steered.resolved();
  return steered.resolved_with(steered_effects(log, steered.drive()));
}

Config load_drive(const std::string& file_or_preset, const std::vector<std::string>& overrides) {
  Config config = Config::load(file_or_preset, overrides);
  read_all_tables(config);
  for (const std::int64_t k : config.drive().model_changes()) config.known_at(k);
  if (!config.drive().model_changes().empty() && config.read<MonitorParameters>().enabled)
    throw BadInput(
        fmt::format("{}: monitor.enabled: false allowed beside known_from_s and known_to_s",
                    config.where("monitor.enabled")));
  return config;
}

}  // namespace twinrate

#include "loop/load_drive.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "controller/controller.hpp"
#include "core/bridge_parameters.hpp"
#include "core/bus_parameters.hpp"
#include "core/logger_parameters.hpp"
#include "core/steering.hpp"
#include "estimator/registry.hpp"
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
  return {owned_table<PlantParameters>(),   owned_table<SafetyParameters>(),
          owned_table<BusParameters>(),     owned_table<LoggerParameters>(),
          owned_table<MonitorParameters>(), owned_table<BridgeParameters>(),
          owned_table<SteeringParameters>()};
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

std::string steered_drive_file(const RunLog& log) {
  Config config = Config::parse(log.config_toml, log.path + " (DRIVE_MANIFEST)");
  read_all_tables(config);
  Config steered = Config::parse(config.resolved(), log.path,
                                 steered_overrides(config, steering_in(log), whole_ticks(log)));
  read_all_tables(steered);
  return steered.resolved();
}

Config load_drive(const std::string& file_or_preset, const std::vector<std::string>& overrides) {
  Config config = Config::load(file_or_preset, overrides);
  read_all_tables(config);
  return config;
}

}  // namespace twinrate

// twinrate trace --plan: options, progress, files.
#pragma once
#include <CLI/CLI.hpp>
#include <functional>

#include "plan/plan.hpp"

namespace twinrate {

struct PlanOptions {
  bool wanted = false, no_load_machine = false, one_direction = false;
  std::string duration = "10s", kinds;
  PlanRequest request;
};

// Returns the option --plan, which the other options need.
CLI::Option* add_plan_options(CLI::App& verb, PlanOptions& options);

struct PlanOutput {
  std::string directory;
  bool force = false, json_lines = false;
};

// Writes plan.toml, plan.json and plan.svg and prints the plan. `logs` reads the logs of --data.
// Throws BadInput.
int plan_measurement(const PlanOptions& options, const Config& drive, const PlanOutput& output,
                     const std::function<std::vector<PlanLog>()>& logs);

}  // namespace twinrate

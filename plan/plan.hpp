// twinrate trace --plan: a profile that lets the tracer tell effects apart, proposed before a
// measurement or on top of a log.
//
//   building blocks -> simulated with the declared model and its sensor noise -> information of
//   each (trace/plan_information.hpp) -> chosen one after another (trace/plan.hpp) -> the whole run
//   simulated once more, and judged as the tracer would judge it
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "trace/plan_blocks.hpp"
#include "trace/plan_information.hpp"

namespace twinrate {

struct PlanRequest {
  std::vector<std::string> kinds;  // empty: all
  double longest_s = 10;
  double speed_max_rpm = 0, i_max_A = 0, T_load_max_Nm = -1;  // where they are not the drive's own
  bool load_machine = true, reverse = true;
};

// A log that is there already.
struct PlanLog {
  Record record;
  Health health;
};

struct NotSeparated {
  std::string a, b;  // b empty: a cannot be seen at all
  std::string why;
};

// A kind that the design does not judge (kinds_outside_the_design()).
struct OutsideKind {
  std::string kind, needs;
  std::vector<std::string> shown_by;  // blocks, any of which is enough; empty: any run
  bool in_run = false;                // the plan has what it needs
  std::string log;                    // what the log says of it; empty: no log
};

struct Plan {
  PlanRequest request;
  Bench bench;
  std::vector<PlanBlock> blocks;   // those to choose from
  std::vector<std::size_t> order;  // chosen
  PlanProfile profile;
  std::vector<std::string> overrides;  // of the drive file: the profile, and what it needs
  std::vector<std::string> kinds;
  std::vector<KindOutlook> log;    // with the present log; empty: none
  std::vector<KindOutlook> after;  // with the proposed run, and the log where there is one
  std::vector<NotSeparated> never;
  std::vector<OutsideKind> outside;
  bool checked = false;  // `after` comes from a simulation of the whole run, not from the blocks
  std::vector<std::string> notes;
  std::string sentence;
};

struct PlanHooks {
  std::function<void(const std::string& what, double share)> progress;
  std::function<bool()> stop;  // true: go on with what is there
};

// Throws BadInput.
Plan make_plan(const Config& drive, const PlanRequest& request, const std::vector<PlanLog>& logs,
               const PlanHooks& hooks);

// The drive with the run in it.
std::string plan_toml(const Config& drive, const Plan& plan);
std::string plan_json(const Plan& plan);
std::string plan_svg(const Plan& plan);
std::string plan_table(const Plan& plan);  // for a terminal

}  // namespace twinrate

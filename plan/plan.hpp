// twinrate trace --plan: proposes a profile that makes effects identifiable and separates them from
// each other, before a measurement or in addition to logs.
//
//   building blocks -> simulation with the declared model and its sensor noise
//                   -> information matrix of each block (trace/plan_information.hpp)
//                   -> forward selection of blocks (trace/plan.hpp)
//                   -> simulation of the whole run -> information matrix of the run
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
  double speed_max_rpm = 0, i_max_A = 0, T_load_max_Nm = -1;  // defaults: limits of the drive
  bool load_machine = true, reverse = true;
};

// An existing log.
struct PlanLog {
  Record record;
  Health health;
};

struct NotSeparated {
  std::string a, b;  // kinds; b empty: a is not identifiable
  std::string why;
};

// A kind without an information matrix (kinds_outside_the_design()).
struct OutsideKind {
  std::string kind, needs;
  std::vector<std::string> shown_by;  // blocks, one of which is enough; empty: any run
  bool in_run = false;                // the proposed run fulfils `needs`
  std::string log;                    // result for the log; empty: no log
};

struct Plan {
  PlanRequest request;
  Bench bench;
  std::vector<PlanBlock> blocks;   // all building blocks
  std::vector<std::size_t> order;  // indices of the chosen blocks
  PlanProfile profile;
  std::vector<std::string> overrides;  // keys of the drive file that set the profile
  std::vector<std::string> kinds;
  std::vector<KindOutlook> log;    // with the existing logs; empty: no log
  std::vector<KindOutlook> after;  // with the proposed run and the existing logs
  std::vector<NotSeparated> never;
  std::vector<OutsideKind> outside;
  bool checked = false;  // `after` is from the simulated run; false: from the sum of the blocks
  std::vector<std::string> notes;
  std::string sentence;
};

struct PlanHooks {
  std::function<void(const std::string& what, double share)> progress;
  std::function<bool()> stop;  // true: continue with the results so far
};

// Throws BadInput.
Plan make_plan(const Config& drive, const PlanRequest& request, const std::vector<PlanLog>& logs,
               const PlanHooks& hooks);

// The drive file with the proposed run.
std::string plan_toml(const Config& drive, const Plan& plan);
std::string plan_json(const Plan& plan);
std::string plan_svg(const Plan& plan);
std::string plan_table(const Plan& plan);  // for a terminal

}  // namespace twinrate

// Every verb of twinrate, in the order of --help.
#include "run/own_monitor.hpp"
#include "tools/run_verb.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

void add_verbs(CLI::App& app, int& exit_code) {
  add_launch_verb(app, exit_code);
  add_bridge_verb(app, exit_code);
  add_machine_verb(app, exit_code);
  add_monitor_verb(app, exit_code);
  add_new_verb(app, exit_code);
  add_simulate_verb(app, exit_code, make_own_monitor);
  add_check_verb(app, exit_code);
  add_replay_verb(app, exit_code);
  add_identify_verb(app, exit_code);
  add_import_verb(app, exit_code);
  add_export_verb(app, exit_code);
  add_report_verb(app, exit_code);
  add_figures_verb(app, exit_code);
  add_response_verb(app, exit_code);
  add_spy_verb(app, exit_code);
  add_set_verb(app, exit_code);
  add_watch_verb(app, exit_code);
  add_scope_verb(app, exit_code);
  add_stream_verb(app, exit_code);
  add_doctor_verb(app, exit_code);
  add_design_verb(app, exit_code);
  add_effects_verb(app, exit_code);
  add_sweep_verb(app, exit_code);
  add_trace_verb(app, exit_code);
  add_tune_verb(app, exit_code);
  add_pages_verb(app, exit_code);
}

}  // namespace

int run_verb(int argc, const char* const* argv) {
  return run_verb_of(add_verbs, argc, argv);
}

}  // namespace twinrate

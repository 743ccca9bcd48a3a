// The command line of twinrate. Each verb has its own file.
#include "core/command_line.hpp"
#include "core/config.hpp"
#include "core/paths.hpp"
#include "tools/run_verb.hpp"
#include "tools/verb.hpp"

namespace twinrate {
int run_verb(int argc, const char* const* argv) {
  remember_command(command_text(argc, argv));
  CLI::App app{"Run, record and examine PMSM drives with a two-rate Kalman filter over LCM"};
  app.set_version_flag("--version", "twinrate " + revision());
  app.require_subcommand(0, 1);
  int exit_code = 0;
  add_launch_verb(app, exit_code);
  add_bridge_verb(app, exit_code);
  add_machine_verb(app, exit_code);
  add_monitor_verb(app, exit_code);
  add_new_verb(app, exit_code);
  add_simulate_verb(app, exit_code);
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
  expect_stated_values(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    throw BadInput(error.what());
  }
  if (app.get_subcommands().empty()) throw BadInput("a verb is required; see twinrate --help");
  return exit_code;
}

}  // namespace twinrate

// twinrate: the command line. Each verb has its own file.
#include <fmt/format.h>

#include <cstdio>

#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/paths.hpp"
#include "tools/verb.hpp"

// What throws before parse() is a mistake in the verbs, and ends the program.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  using namespace twinrate;
  CLI::App app{"Run, record and examine PMSM drives with a two-rate Kalman filter over LCM"};
  app.set_version_flag("--version", "twinrate " + revision());
  app.require_subcommand(0, 1);
  int exit_code = 0;
  add_launch_verb(app, exit_code);
  add_machine_verb(app, exit_code);
  add_monitor_verb(app, exit_code);
  add_simulate_verb(app, exit_code);
  add_check_verb(app, exit_code);
  add_replay_verb(app, exit_code);
  add_import_verb(app, exit_code);
  add_export_verb(app, exit_code);
  add_report_verb(app, exit_code);
  add_watch_verb(app, exit_code);
  add_doctor_verb(app, exit_code);
  add_design_verb(app, exit_code);
  add_effects_verb(app, exit_code);
  add_sweep_verb(app, exit_code);
  add_trace_verb(app, exit_code);
  try {
    app.parse(argc, argv);
    if (app.get_subcommands().empty()) throw BadInput("a verb is required; see twinrate --help");
    return exit_code;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    fmt::print(stderr, "twinrate: {}\n", error.what());
    return 2;
  } catch (const BadInput& error) {
    fmt::print(stderr, "twinrate: {}\n", error.what());
    return 2;
  } catch (const MachineError& error) {
    fmt::print(stderr, "twinrate: {}\n", error.what());
    return 3;
  } catch (const std::exception& error) {
    fmt::print(stderr, "twinrate: {}\n", error.what());
    return 1;
  }
}

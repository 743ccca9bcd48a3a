// The verbs of `twinrate`, one in each file: add_*_verb() adds its sub-command and callback.
//
// A callback returns for exit code 0, throws BadInput for 2, and sets `exit_code` for other codes.
#pragma once
#include <CLI/CLI.hpp>

#include "core/config.hpp"
#include "core/option_values.hpp"
#include "run/simulated_run.hpp"

namespace twinrate {

void add_bridge_verb(CLI::App& app, int& exit_code);
void add_launch_verb(CLI::App& app, int& exit_code);
void add_machine_verb(CLI::App& app, int& exit_code);
void add_figures_verb(CLI::App& app, int& exit_code);
void add_monitor_verb(CLI::App& app, int& exit_code);
void add_new_verb(CLI::App& app, int& exit_code);
void add_pages_verb(CLI::App& app, int& exit_code);
void add_simulate_verb(CLI::App& app, int& exit_code, MakeTickWatch make_monitor);
void add_spy_verb(CLI::App& app, int& exit_code);
void add_check_verb(CLI::App& app, int& exit_code);
void add_replay_verb(CLI::App& app, int& exit_code);
void add_identify_verb(CLI::App& app, int& exit_code);
void add_import_verb(CLI::App& app, int& exit_code);
void add_export_verb(CLI::App& app, int& exit_code);
void add_doctor_verb(CLI::App& app, int& exit_code);
void add_set_verb(CLI::App& app, int& exit_code);
void add_watch_verb(CLI::App& app, int& exit_code);
void add_report_verb(CLI::App& app, int& exit_code);
void add_response_verb(CLI::App& app, int& exit_code);
void add_design_verb(CLI::App& app, int& exit_code);
void add_effects_verb(CLI::App& app, int& exit_code);
void add_scope_verb(CLI::App& app, int& exit_code);
void add_stream_verb(CLI::App& app, int& exit_code);
void add_sweep_verb(CLI::App& app, int& exit_code);
void add_trace_verb(CLI::App& app, int& exit_code);
void add_tune_verb(CLI::App& app, int& exit_code);

// Parses a command line, the verbs of which `add_verbs` adds, and runs the verb that it names. The
// rest as run_verb().
using AddVerbs = void (*)(CLI::App& app, int& exit_code);
int run_verb_of(AddVerbs add_verbs, int argc, const char* const* argv);

// For a part that a build with some of the verbs lacks: throws MachineError, with the command that
// builds it. A listed absent verb is refused whatever its options are.
[[noreturn]] void refuse_absent(const std::string& what);
void add_absent_verb(CLI::App& app, const char* name, const char* purpose);

// launch with a real drive as the plant; returns its exit code.
struct BridgeLaunch {
  std::string drive, run_dir, duration, pace;
  std::vector<std::string> overrides;
  bool force = false;
};
int launch_bridge(const BridgeLaunch& launch);
// load_drive(); bridge.emulate without a port gets a free UDP port of this machine.
Config load_with_port(const std::string& drive, std::vector<std::string> overrides);

}  // namespace twinrate

// The verbs of `twinrate`, one in each file: add_*_verb() adds its sub-command and callback.
//
// A callback returns for exit code 0, throws BadInput for 2, and sets `exit_code` for other codes.
#pragma once
#include <CLI/CLI.hpp>

namespace twinrate {

void add_launch_verb(CLI::App& app, int& exit_code);
void add_machine_verb(CLI::App& app, int& exit_code);
void add_monitor_verb(CLI::App& app, int& exit_code);
void add_simulate_verb(CLI::App& app, int& exit_code);
void add_check_verb(CLI::App& app, int& exit_code);
void add_replay_verb(CLI::App& app, int& exit_code);
void add_import_verb(CLI::App& app, int& exit_code);
void add_export_verb(CLI::App& app, int& exit_code);
void add_doctor_verb(CLI::App& app, int& exit_code);
void add_watch_verb(CLI::App& app, int& exit_code);
void add_report_verb(CLI::App& app, int& exit_code);
void add_design_verb(CLI::App& app, int& exit_code);
void add_effects_verb(CLI::App& app, int& exit_code);
void add_sweep_verb(CLI::App& app, int& exit_code);
void add_trace_verb(CLI::App& app, int& exit_code);

}  // namespace twinrate

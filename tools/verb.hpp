// The verbs of `twinrate`, one file each: every add_*_verb() hangs its sub-command and callback
// into the program.
//
// A callback returns normally for exit code 0, throws BadInput for 2, and sets `exit_code` for
// anything else.
#pragma once
#include <CLI/CLI.hpp>

namespace twinrate {

void add_launch_verb(CLI::App& app, int& exit_code);
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

// The command line as a function: of the program twinrate, and of the Python module.
#pragma once

namespace twinrate {

// Runs the verb of a command line, argv[0] being the program. Returns its exit code; --help prints
// and returns 0. Throws BadInput (exit code 2), MachineError (3), std::runtime_error (1).
int run_verb(int argc, const char* const* argv);
// The same with the verbs of verbs_simulated.cpp alone.
int run_simulated_verb(int argc, const char* const* argv);

}  // namespace twinrate

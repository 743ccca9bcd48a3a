// The command line of the program that runs simulated drives alone.
#include "tools/run_verb.hpp"

namespace twinrate {

int run_verb(int argc, const char* const* argv) {
  return run_simulated_verb(argc, argv);
}

}  // namespace twinrate

// The simulated run of the verb simulate, for the Python module too.
#pragma once
#include <string>
#include <vector>

#include "run/simulated_run.hpp"

namespace twinrate {

struct SimulateOptions {
  std::string drive, run_dir;
  std::vector<std::string> overrides;
  std::string duration;
  bool json = false, monitor = false, force = false;
  bool quiet = false;                    // prints no table, leaves the stop signals to the caller
  MakeTickWatch make_monitor = nullptr;  // of monitor.enabled; null: a build without the tracer
};

// Runs the drive and writes its run directory. Returns the exit code: 0 if the run is locked.
// Throws BadInput, or MachineError: monitor.enabled without the tracer. `make`: the filter, that of the drive file or an own one.
int simulate(const SimulateOptions& o, const MakeFilter& make = make_filter);

}  // namespace twinrate

// The machine cannot do the task (no multicast route, no permission): the program prints what() and
// exits with code 3.
#pragma once
#include <stdexcept>

namespace twinrate {

struct MachineError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace twinrate

// The controller of a drive file, with its own table read, behind the guard of
// controller/guarded.hpp.
#pragma once
#include "controller/controller.hpp"
#include "core/config.hpp"

namespace twinrate {

// After a reset the rotor angle is unknown. A drive without an angle sensor begins with alignment
// and I/f ramp, whatever `start` is; a drive with one begins at standstill.
enum class Begin { kAsConfigured, kAfterReset };

// Throws BadInput if the kind or a key of its table is unknown.
std::unique_ptr<Controller> make_controller(Config& config, Begin begin = Begin::kAsConfigured);

}  // namespace twinrate

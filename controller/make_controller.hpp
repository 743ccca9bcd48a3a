// The controller that a drive file asks for, with its own table read, behind the guard of
// controller/guarded.hpp.
#pragma once
#include "controller/controller.hpp"
#include "core/config.hpp"

namespace twinrate {

// After a reset nobody knows where the rotor stands: a drive without an angle sensor begins with
// alignment and I/f ramp, whatever `start` says; with one, at standstill.
enum class Begin { kAsConfigured, kAfterReset };

// Throws BadInput where the kind or a key of its table is unknown.
std::unique_ptr<Controller> make_controller(Config& config, Begin begin = Begin::kAsConfigured);

}  // namespace twinrate

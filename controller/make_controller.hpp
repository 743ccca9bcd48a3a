// The controller that a drive file asks for, with its own table read, behind the guard of
// controller/guarded.hpp.
#pragma once
#include "controller/controller.hpp"
#include "core/config.hpp"

namespace twinrate {

// Throws BadInput where the kind or a key of its table is unknown.
std::unique_ptr<Controller> make_controller(Config& config);

}  // namespace twinrate

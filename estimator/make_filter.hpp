// The filter that a drive file asks for, with its own table read.
#pragma once
#include "core/config.hpp"
#include "estimator/registry.hpp"

namespace twinrate {

// Throws BadInput where the kind or a key of its table is unknown.
std::shared_ptr<const Filter> make_filter(Config& config);

}  // namespace twinrate

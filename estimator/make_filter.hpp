// The filter that a drive file asks for, with its own table read, and the two halves around it.
#pragma once
#include "core/config.hpp"
#include "estimator/registry.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {

// Throws BadInput where the kind or a key of its table is unknown.
std::shared_ptr<const Filter> make_filter(Config& config);

// Throws BadInput where the filter cannot run the drive's gain policy.
void require_policy(const Config& config, const Filter& filter);

// `fall_back`: a background that falls silent is replaced by the table over speed (realtime). The
// table is computed here. Throws BadInput where policy `scheduled` is asked for and the filter has
// no table.
FastLoop make_fast_loop(Config& config, bool fall_back);
BackgroundLoop make_background_loop(Config& config);

}  // namespace twinrate

// The filter that a drive file asks for, with its own table read, and the two halves around it.
#pragma once
#include <functional>

#include "core/config.hpp"
#include "estimator/registry.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {

// Throws BadInput if the kind or a key of its table is unknown.
std::shared_ptr<const Filter> make_filter(Config& config);

// The effects that a filter of this drive compensates before its equations.
KnownEffects known_effects(const DriveConfig& drive);

// A way to make the filter: make_filter, or that of an own filter.
using MakeFilter = std::function<std::shared_ptr<const Filter>(Config&)>;

// Throws BadInput if the filter cannot run the drive's gain policy.
void require_policy(const Config& config, const Filter& filter);
void require_policy(const Config& config, const Filter& filter, GainPolicy policy);

// "" if filter and controller of the drive support this compensation, else the missing condition.
std::string compensation_needs(Compensation wanted, const DriveConfig& drive, const Filter& filter);

// True if the gain comes from the table over speed (estimator/gain_schedule.hpp) at any time of the
// run, including the policies of steering.policy.
bool uses_table(Config& config);

// `fall_back`: the table over speed replaces a silent background (realtime). The table is computed
// here, or is `table`, if the caller has it. Throws BadInput if policy `scheduled` is requested and
// the filter has no table.
using GainTable = std::shared_ptr<const GainSchedule>;
FastLoop make_fast_loop(Config& config, bool fall_back, const MakeFilter& make = make_filter,
                        const GainTable& table = nullptr);
BackgroundLoop make_background_loop(Config& config, const MakeFilter& make = make_filter);

}  // namespace twinrate

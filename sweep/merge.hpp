// Merges the shards of a sweep into one result.
#pragma once
#include <string>
#include <vector>

namespace twinrate::sweep {

// `directories`: shard directories, or their parents (shard-0-of-2 ..). Throws BadInput: shards of
// different sweeps, a missing or repeated point.
void merge(const std::vector<std::string>& directories, const std::string& out, bool json,
           bool force = false);

}  // namespace twinrate::sweep

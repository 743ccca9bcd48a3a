// One result out of the shards of a sweep.
#pragma once
#include <string>
#include <vector>

namespace twinrate::sweep {

// `directories`: shard directories, or directories that hold some (shard-0-of-2 ..). Throws
// BadInput: shards of different sweeps, a point that is missing or there twice.
void merge(const std::vector<std::string>& directories, const std::string& out, bool json);

}  // namespace twinrate::sweep

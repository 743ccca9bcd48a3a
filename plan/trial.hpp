// Simulates the building blocks of a plan on the declared drive.
#pragma once
#include "plan/simulate.hpp"

namespace twinrate {

// The profile as keys of the drive file, in the file's unit of speed.
std::vector<std::string> overrides_of(const DriveConfig& drive, const Bench& bench,
                                      const PlanProfile& profile);
// Throws BadInput if the signals do not form a record.
PlanLog record_of(const RawLog& raw, int n_p);

// One simulated run of all blocks.
struct Trial {
  PlanLog log;
  std::vector<PlanBlock> all;
  std::vector<std::size_t> blocks;  // indices of the blocks that the simulated drive follows
  std::vector<RowSpan> spans;       // rows of the log, for each of `blocks`
  std::vector<std::size_t> unfit;   // indices of the other blocks
};
// If too many blocks are unfit, `bench` is made slower and the trial repeated. Throws BadInput if
// the drive follows no block.
Trial try_blocks(const Config& drive, Bench& bench, const PlanHooks& hooks);

}  // namespace twinrate

// The building blocks of a plan, tried on the declared drive.
#pragma once
#include "plan/simulate.hpp"

namespace twinrate {

// The profile as keys of the drive file, in the unit of speed that the file has.
std::vector<std::string> overrides_of(const DriveConfig& drive, const Bench& bench,
                                      const PlanProfile& profile);
// Throws BadInput where the signals do not make a record.
PlanLog record_of(const RawLog& raw, int n_p);

// Every block once, one after another.
struct Trial {
  PlanLog log;
  std::vector<PlanBlock> all;
  std::vector<std::size_t> blocks;  // of all: those that the simulated drive keeps to
  std::vector<RowSpan> spans;       // of the log, block by block
  std::vector<std::size_t> unfit;   // of all: the others
};
// Where too many blocks are unfit, `bench` is made slower and they are tried again. Throws BadInput
// where none fits.
Trial try_blocks(const Config& drive, Bench& bench, const PlanHooks& hooks);

}  // namespace twinrate

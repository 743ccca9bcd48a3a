// Loads a drive file and reads the tables of every owner.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"
#include "core/run_log.hpp"

namespace twinrate {

// The tables of a drive file owned by folders above core, without those of filters and controllers.
std::vector<OwnedTable> owned_tables();

// Reads owned_tables(), the tables of the chosen filter and controller, and the tables of other
// kinds in the file: resolved() is then complete. Throws BadInput, also for an unknown table or key.
Config load_drive(const std::string& file_or_preset,
                  const std::vector<std::string>& overrides = {});
// The same for a parsed config (the one in a log).
void read_all_tables(Config& config);

// Ticks of a recorded run up to the last COMMAND.
std::int64_t whole_ticks(const RunLog& log);

// The drive file of a recorded run, with the steered values as profiles: a run from it equals the
// recorded one. Throws BadInput.
std::string steered_drive_file(const RunLog& log, bool with_effects = true);

}  // namespace twinrate

// A drive file with every owner's tables read: what `check`, `launch`, `simulate` and `replay`
// start from.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// The tables of a drive file that folders above core own, but for those of the kinds of filter and
// controller.
std::vector<OwnedTable> owned_tables();

// Reads owned_tables(), the tables of the chosen filter and controller, and those of other kinds
// that the file holds, so that resolved() is complete and every unknown table or key is found.
// Throws BadInput.
Config load_drive(const std::string& file_or_preset,
                  const std::vector<std::string>& overrides = {});
// The same for a config that is already parsed (the one inside a log).
void read_all_tables(Config& config);

}  // namespace twinrate

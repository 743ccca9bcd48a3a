// Keys that a user set and no chosen part reads.
//
// A key of --set or of the user's own file that has no effect with the filter, controller and
// policies of the drive is refused by name. The keys of a preset and of a resolved file
// (config.toml of a run) are not: a preset holds the keys of its alternatives. Nor is a key of a
// file that a preset has with the same value: the file began as a copy of it.
#pragma once
#include <string>

#include "core/config.hpp"

namespace twinrate {

// Throws BadInput at the first such key: where, what, and with which setting it is read. Requires
// read_all_tables().
void refuse_unused_keys(Config& config);

// Keys of the user that nothing reads if the drive is a real one (plant.kind = bridge, not
// emulated), in the mode of the bridge; the same file may simulate it. "": none.
std::string keys_unread_by_a_real_drive(Config& config);

}  // namespace twinrate

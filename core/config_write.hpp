// The writing side of core/config: the same field lists, written out as TOML or as rows of the
// reference page.
#pragma once
#include <functional>
#include <string>

#include "core/drive_config.hpp"

namespace twinrate {

// A line of every resolved file: it holds all keys, also those that no part of its drive reads.
inline constexpr const char* kResolvedMark = "# resolved by twinrate: every key, in use or not";

std::string write_table(const std::string& path, const std::function<void(FieldVisitor&)>& fields);
// `owned`: the text of a table that belongs to another folder, by its name.
std::string write_drive(const DriveConfig& drive,
                        const std::function<std::string(const char*)>& owned);
std::string write_effects(const DriveConfig& drive);

}  // namespace twinrate

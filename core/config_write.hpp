// The writing side of core/config: the same field lists, written out as TOML or as rows of the
// reference page.
#pragma once
#include <functional>
#include <string>

#include "core/drive_config.hpp"

namespace twinrate {

std::string write_table(const std::string& path, const std::function<void(FieldVisitor&)>& fields);
// `owned`: the text of a table that belongs to another folder, by its name.
std::string write_drive(const DriveConfig& drive,
                        const std::function<std::string(const char*)>& owned);
std::string write_effects(const DriveConfig& drive);

}  // namespace twinrate

// Files embedded in the program: the page, uPlot, and lcmtypes/*.lcm. cmake/embed.cmake writes the
// table.
#pragma once
#include <span>
#include <string_view>

namespace twinrate::scope {

struct Asset {
  std::string_view name;  // "scope.js"
  std::string_view bytes;
};

std::span<const Asset> assets();
// nullptr if there is no such file.
const Asset* find_asset(std::string_view name);

}  // namespace twinrate::scope

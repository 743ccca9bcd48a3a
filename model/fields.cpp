#include "model/fields.hpp"

#include <array>
#include <string_view>

namespace twinrate {
namespace {

// Longer suffixes first: "rad_s" before "s".
constexpr std::array<std::string_view, 24> kUnits = {
    "Nms_rad", "rad_s2", "per_rev", "Nm_rad", "rad_s", "Nm_s", "Nms2", "kgm2",
    "degC",    "Nms",    "Ohm",     "rad",    "H_A",   "Nm",   "Wb",   "Hz",
    "H_A2",    "ms",     "us",      "ns",     "A",     "V",    "H",    "s"};

}  // namespace

NameAndUnit split_unit(const std::string& key) {
  if (key == "order") return {key, "per_rev"};
  for (std::string_view unit : kUnits) {
    const std::string suffix = "_" + std::string(unit);
    if (key.size() > suffix.size() && key.ends_with(suffix))
      return {key.substr(0, key.size() - suffix.size()), std::string(unit)};
  }
  return {key, "1"};
}

}  // namespace twinrate

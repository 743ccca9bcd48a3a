// A drive file with overrides, and the parts of its drive.
#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "controller/make_controller.hpp"
#include "core/config.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate::test {

using Overrides = std::vector<std::string>;

// A preset, changed: load("dilys2021", {"rates.n=4"}).
inline Config load(const std::string& preset, const Overrides& overrides = {}) {
  return Config::load(preset, overrides);
}

inline DriveConfig drive_of(const std::string& preset, const Overrides& overrides = {}) {
  return Config::load(preset, overrides).drive();
}

// A preset's name as GoogleTest wants it: no hyphens.
inline std::string gtest_name(std::string preset) {
  std::replace(preset.begin(), preset.end(), '-', '_');
  return preset;
}

// Degrees are for people, and the reference table is in degrees.
inline double degrees(double angle_rad) {
  return angle_rad * 180 / kPi;
}

// True in builds with AddressSanitizer, which run about twenty times slower.
#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

}  // namespace twinrate::test

// The pages of the gallery: every effect of the registry, and settings of a sensor.
#pragma once
#include <string>
#include <vector>

#include "model/effects/portrait.hpp"

namespace twinrate::gallery {

struct Entry {
  std::string name;  // an effect's kind, or a name for a setting
  std::string meaning;
  Portrait portrait;
  const char* setting = nullptr;  // key=value of the drive file instead of an effect
};

// By name.
std::vector<Entry> entries();

}  // namespace twinrate::gallery

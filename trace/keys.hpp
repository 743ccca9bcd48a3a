// Reads and sets one numeric parameter of an effect by its key, through its field list. Whole
// numbers are rounded, a choice is its position.
#pragma once
#include <string>
#include <vector>

#include "model/effects/effect.hpp"

namespace twinrate {

struct NumericKey {
  std::string key;
  double value = 0, lo = 0, hi = 0;
  bool whole = false;
  std::string text;  // name of a choice
};

// Every numeric parameter, in the order of the field list.
std::vector<NumericKey> numeric_keys(const Effect& effect);
std::vector<double> key_values(const Effect& effect);
double get_key(const Effect& effect, const std::string& key);
// The value is held inside the key's range; false where it had to be.
bool set_key(Effect& effect, const std::string& key, double value);
// Every number stands inside its range.
bool within_ranges(const Effect& effect);

}  // namespace twinrate

// Reads and sets one numeric parameter of an effect by its key, through its field list. Whole
// numbers are rounded, a choice is its position.
#pragma once
#include <string>
#include <vector>

#include "model/effects/tracing.hpp"

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
bool has_key(const Effect& effect, const std::string& key);
double get_key(const Effect& effect, const std::string& key);
// The value is held inside the key's range; false where it had to be.
bool set_key(Effect& effect, const std::string& key, double value);
// The effect by the other name of a reading, with the parameters that follow from its own. A value
// is held inside its range there; fits: none had to be.
struct OtherName {
  std::shared_ptr<Effect> effect;
  bool fits = true;
};
OtherName read_as(const Effect& effect, const Traits::Reading& reading, const DriveFacts& facts);
// Every number stands inside its range.
bool within_ranges(const Effect& effect);

}  // namespace twinrate

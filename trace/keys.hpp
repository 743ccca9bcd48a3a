// Reads and sets one numeric parameter of an effect by its key, through its field list. Integers
// are rounded. A choice is represented by its index.
#pragma once
#include <string>
#include <vector>

#include "model/effects/tracing.hpp"

namespace twinrate {

struct NumericKey {
  std::string key;
  double value = 0, lo = 0, hi = 0;
  bool whole = false;
  std::string text;  // name of the choice
};

// Every numeric parameter, in the order of the field list.
std::vector<NumericKey> numeric_keys(const Effect& effect);
std::vector<double> key_values(const Effect& effect);
bool has_key(const Effect& effect, const std::string& key);
double get_key(const Effect& effect, const std::string& key);
// Clamps the value to the key's range; false if it was outside.
bool set_key(Effect& effect, const std::string& key, double value);
// The equivalent effect of a reading, with the parameters that follow from the given effect. Values
// are clamped to their ranges; fits: none had to be.
struct OtherName {
  std::shared_ptr<Effect> effect;
  bool fits = true;
};
OtherName read_as(const Effect& effect, const Traits::Reading& reading, const DriveFacts& facts);
// True if every number is finite and within its range.
bool within_ranges(const Effect& effect);

}  // namespace twinrate

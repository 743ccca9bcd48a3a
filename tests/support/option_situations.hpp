// Situations that an option needs to act: a fault, a loss of synchronism, a second speed.
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "tests/support/drives.hpp"

namespace twinrate::test {

struct Situation {
  std::string key;  // or the beginning of keys, where it ends with a dot
  Overrides
      with;  // CONTROLLER stands for the table of the chosen controller, T for the rated torque
  bool last = false;  // tried after all variants without it
};

const std::vector<Situation>& situations();
// What acts outside the loop that `simulate` closes.
const std::vector<std::pair<std::string, std::string>>& acts_elsewhere();

// `list`, whose keys `more` replaces.
Overrides joined(const Overrides& list, const Overrides& more);

}  // namespace twinrate::test

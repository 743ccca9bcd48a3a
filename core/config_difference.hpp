// The differences between drive files.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

struct DifferingKey {
  std::string path;                 // "rates.n", "effect[0].kind"
  std::vector<std::string> values;  // one of each file, as TOML; empty if it has no such key
};

// The keys with different values in two of the files, in the order of their paths. Throws BadInput
// for a text that is not TOML.
std::vector<DifferingKey> differing_keys(const std::vector<std::string>& toml_texts);

}  // namespace twinrate

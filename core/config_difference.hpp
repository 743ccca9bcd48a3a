// What differs between drive files.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

struct DifferingKey {
  std::string path;                 // "rates.n", "effect[0].kind"
  std::vector<std::string> values;  // one of each file, as TOML; empty where it has no such key
};

// The keys of which two of the files have other values, in the order of their paths. Throws BadInput for
// a text that is no TOML.
std::vector<DifferingKey> differing_keys(const std::vector<std::string>& toml_texts);

}  // namespace twinrate

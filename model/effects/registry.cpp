#include "model/effects/registry.hpp"

#include <iterator>

namespace twinrate {
namespace {

struct Entry {
  std::string_view kind;
  std::shared_ptr<Effect> (*make)();
};
constexpr Entry kEntries[] = {
    {"cogging", make_cogging},
    {"coulomb_friction", make_coulomb_friction},
};

}  // namespace

std::shared_ptr<Effect> make_effect(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make();
  return nullptr;
}

std::vector<std::string> effect_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate

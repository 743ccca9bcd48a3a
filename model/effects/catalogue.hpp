// Questions to the whole registry, answered by the effects' traits.
#pragma once
#include <functional>

#include "model/effects/tracing.hpp"

namespace twinrate {

// Kinds whose traits hold, in the order of the registry.
std::vector<std::string> kinds_with(const std::function<bool(const Traits&)>& holds);
// The members of a family by rank.
std::vector<std::string> kinds_of(Traits::Family family);
// The first kind with this place, or of this family. Asserts that there is one.
std::shared_ptr<Effect> make_placed(Traits::Place place);
std::shared_ptr<Effect> make_of(Traits::Family family);

inline bool is_placed(const Effect& effect, Traits::Place place) {
  return effect.tracing().traits().place == place;
}
inline bool is_of(const Effect& effect, Traits::Family family) {
  return effect.tracing().traits().family.name == family;
}
// Null if it has no such reading; the first if it has several.
const Traits::Reading* reading_of(const Effect& effect, Traits::Reading::When when);
// The kinds of all its readings under that condition.
std::vector<std::string> kinds_read(const Effect& effect, Traits::Reading::When when);

}  // namespace twinrate

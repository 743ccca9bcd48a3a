#include "model/effects/catalogue.hpp"

#include <algorithm>
#include <cassert>

namespace twinrate {
namespace {

Traits traits_of(const std::string& kind) {
  return make_effect(kind)->tracing().traits();
}

std::shared_ptr<Effect> make_first(const std::vector<std::string>& kinds) {
  assert(!kinds.empty());
  return make_effect(kinds.front());
}

}  // namespace

std::vector<std::string> kinds_with(const std::function<bool(const Traits&)>& holds) {
  std::vector<std::string> kinds;
  for (const std::string& kind : effect_kinds())
    if (holds(traits_of(kind))) kinds.push_back(kind);
  return kinds;
}

std::vector<std::string> kinds_of(Traits::Family family) {
  std::vector<std::string> kinds =
      kinds_with([&](const Traits& traits) { return traits.family.name == family; });
  std::stable_sort(kinds.begin(), kinds.end(), [](const auto& a, const auto& b) {
    return traits_of(a).family.rank < traits_of(b).family.rank;
  });
  return kinds;
}

std::shared_ptr<Effect> make_placed(Traits::Place place) {
  return make_first(kinds_with([&](const Traits& traits) { return traits.place == place; }));
}

std::shared_ptr<Effect> make_of(Traits::Family family) {
  return make_first(kinds_of(family));
}

const Traits::Reading* reading_of(const Effect& effect, Traits::Reading::When when) {
  const Stated<Traits::Reading> readings = effect.tracing().traits().readings;
  for (const Traits::Reading& reading : readings)
    if (reading.when == when) return &reading;
  return nullptr;
}

std::vector<std::string> kinds_read(const Effect& effect, Traits::Reading::When when) {
  const Stated<Traits::Reading> readings = effect.tracing().traits().readings;
  std::vector<std::string> kinds;
  for (const Traits::Reading& reading : readings)
    if (reading.when == when) kinds.emplace_back(reading.kind);
  return kinds;
}

}  // namespace twinrate

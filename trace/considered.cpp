#include "trace/considered.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "model/effects/effect.hpp"

namespace twinrate {

Considered::Considered(std::vector<std::string> excluded) : excluded_(std::move(excluded)) {
  std::sort(excluded_.begin(), excluded_.end());
  excluded_.erase(std::unique(excluded_.begin(), excluded_.end()), excluded_.end());
}

bool Considered::operator()(std::string_view kind) const {
  return !std::binary_search(excluded_.begin(), excluded_.end(), kind);
}

std::vector<std::string> Considered::kinds() const {
  return of(effect_kinds());
}

std::vector<std::string> Considered::of(std::vector<std::string> kinds) const {
  std::erase_if(kinds, [&](const std::string& kind) { return !(*this)(kind); });
  return kinds;
}

void leave_out_excluded(const Considered& considered, TraceResult& r) {
  r.excluded = considered.excluded();
  if (r.excluded.empty()) return;
  for (TracedEffect& e : r.effects) e.aliases = considered.of(std::move(e.aliases));
  std::erase_if(r.ambiguous, [&](Ambiguity& a) {
    const std::size_t before = a.kinds.size();
    a.kinds = considered.of(std::move(a.kinds));
    if (a.kinds.size() == before) return false;
    if (a.kinds.empty()) r.health.push_back(a.why);
    // The ambiguity of a named effect ends if no other name remains.
    const auto is_only_name = [&](const TracedEffect& e) {
      return a.kinds.size() == 1 && e.effect->kind() == a.kinds.front();
    };
    return a.kinds.empty() || std::any_of(r.effects.begin(), r.effects.end(), is_only_name);
  });
  std::erase_if(r.identifiable, [&](const std::string& kind) { return !considered(kind); });
  std::erase_if(r.not_identifiable, [&](const auto& of) { return !considered(of.first); });
}

void tell_excluded(const Considered& considered, TraceResult& r) {
  r.excluded = considered.excluded();
  if (r.excluded.empty() || r.verdict == "inconsistent") return;
  r.sentence +=
      fmt::format(" Not looked for (--exclude): {}.", fmt::join(considered.excluded(), ", "));
}

}  // namespace twinrate

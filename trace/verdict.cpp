#include "trace/verdict.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <vector>

namespace twinrate {
namespace {

// True if a traced effect has an alias in these data.
bool has_other_name(const TraceResult& r) {
  return std::any_of(r.ambiguous.begin(), r.ambiguous.end(), [&](const Ambiguity& a) {
    return std::any_of(r.effects.begin(), r.effects.end(),
                       [&](const TracedEffect& e) { return e.effect->kind() == a.kinds.front(); });
  });
}

}  // namespace

const char* verdict_of(const TraceResult& r) {
  if (r.structured) return "unexplained";
  if (!r.effects.empty()) return has_other_name(r) ? "ambiguous" : "traced";
  if (!r.ambiguous.empty()) return "ambiguous";
  // A refused claim that lowered the raw error of judging rows may be present under another name,
  // although no structure shows it.
  return std::any_of(r.refused.begin(), r.refused.end(), [](const Refused& x) { return x.left; })
             ? "ambiguous"
             : "nothing_missing";
}

std::string nothing_in_words(const TraceResult& r) {
  std::set<std::string_view> shown;  // kinds; `identifiable` may also hold sentences
  for (const std::string& kind : r.identifiable)
    if (kind.find(' ') == std::string::npos) shown.insert(kind);
  const char* looked_for = r.excluded.empty() ? "" : " that were looked for and";
  if (shown.empty())
    return fmt::format("Of the effects{} that these data can show none is missing in the model",
                       looked_for);
  return fmt::format(
      "Of the {} kinds of effects{} that these data can show (listed as identifiable) none is "
      "missing in the model",
      shown.size(), looked_for);
}

const Refused* refusal_to_tell(const TraceResult& r) {
  const Refused* told = nullptr;
  for (const Refused& x : r.refused)
    if (x.leaves_doubt() && (!told || (x.left && !told->left))) told = &x;
  return told;
}

std::string refusal_in_words(const Refused& refused) {
  return fmt::format("a claim did not pass the rule of {}{}: {}", refused.rule,
                     refused.file.empty() ? "" : " on " + refused.file, refused.text);
}

std::string headline_begins(const TraceResult& r) {
  if (r.verdict == "ambiguous") {
    const Refused* refused = r.effects.empty() ? refusal_to_tell(r) : nullptr;
    return refused ? fmt::format("Cannot tell: {}. ", refusal_in_words(*refused))
                   : "Ambiguous, see the aliases. ";
  }
  if (r.verdict != "unexplained") return "";
  std::vector<std::string> what;
  for (const Structure& s : r.unexplained) what.push_back(s.text);
  std::string text = "Unexplained";
  if (!what.empty())
    text +=
        fmt::format(": {}, which no {} was shown to explain", fmt::join(what, ", "),
                    r.excluded.empty() ? "effect of the catalogue" : "kind that was looked for");
  if (const Refused* refused = refusal_to_tell(r))
    text += (what.empty() ? ": " : "; ") + refusal_in_words(*refused);
  return text + ". ";
}

}  // namespace twinrate

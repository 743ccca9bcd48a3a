#include "trace/findings.hpp"

namespace twinrate {

Passed not_asked(const Selection& selection) {
  Passed passed{.fit = selection.fit, .kept = {}, .judgements = {}, .refused = {}};
  for (std::size_t m = 0; m < selection.members.size(); ++m) {
    passed.kept.push_back(m);
    passed.judgements.push_back({.held_out_gain = selection.members[m].held_out_gain});
  }
  return passed;
}

std::vector<std::string> wrong_kinds(const std::vector<Refused>& refused) {
  std::vector<std::string> kinds;
  for (const Refused& r : refused)
    if (r.wrong_kind) kinds.push_back(r.kind);
  return kinds;
}

std::vector<std::string> impossible_kinds(const std::vector<Refused>& refused) {
  std::vector<std::string> kinds;
  for (const Refused& r : refused)
    if (r.rule == "physical") kinds.push_back(r.kind);
  return kinds;
}

Findings without_wrong_kinds(
    Findings first, const std::function<Findings(Fit, const std::vector<std::string>&)>& again,
    const std::function<bool(const Findings&, const Findings&)>& as_much) {
  const std::vector<std::string> kinds = wrong_kinds(first.passed.refused);
  if (kinds.empty()) return first;
  Findings second = again(first.passed.fit, kinds);
  if (second.passed.kept.size() <= first.passed.kept.size() || !as_much(first, second))
    return first;
  const std::vector<Refused>& before = first.passed.refused;
  second.passed.refused.insert(second.passed.refused.begin(), before.begin(), before.end());
  return second;
}

Selection what_passed(const Fitter& fitter, const std::vector<Candidate>& candidates,
                      Findings found) {
  const Passed& passed = found.passed;
  Selection selection = std::move(found.selection);
  const bool all = passed.kept.size() == selection.members.size();
  if (all && wrong_kinds(passed.refused).empty()) return selection;
  Members members;
  for (std::size_t m : passed.kept) members.push_back(selection.fit.members[m]->clone());
  Selection anew = compare_alternatives(fitter, candidates, members);
  anew.refused = std::move(selection.refused);
  return anew;
}

}  // namespace twinrate

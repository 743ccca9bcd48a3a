// What a search found, and what of it passed the gate.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "trace/gate.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct Findings {
  Selection selection;
  Passed passed;
  NoiseModel noise;  // that both were made under
};

// Every member passes, as where nobody judged.
Passed not_asked(const Selection& selection);
// Kinds of claims that cannot be what is there.
std::vector<std::string> wrong_kinds(const std::vector<Refused>& refused);
// Kinds that no machine can have so large: no other names of what passed.
std::vector<std::string> impossible_kinds(const std::vector<Refused>& refused);

// What a refused claim explains that cannot be there is something else. `again` searches once more, on from what
// passed, without such kinds; what it finds is taken where more passes and, by `as_much`, explains about as much:
// others that explain far less of it are not what is there. What the first refused stays told.
Findings without_wrong_kinds(
    Findings first,
    const std::function<Findings(Fit, const std::vector<std::string>& left_out)>& again,
    const std::function<bool(const Findings& first, const Findings& second)>& as_much);

// What passed, as the selection judged it: judged anew where others were refused beside it, for
// what could stand in their places is another then.
Selection what_passed(const Fitter& fitter, const std::vector<Candidate>& candidates,
                      Findings found);

}  // namespace twinrate

// The findings of a search, and those of them that passed the gate.
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
  NoiseModel noise;  // under which both were made
};

// Every member passes, as if nothing judged.
Passed not_asked(const Selection& selection);
// Kinds of the claims that cannot be the cause.
std::vector<std::string> wrong_kinds(const std::vector<Refused>& refused);
// Kinds that no machine can have at that size: they are no aliases of a passed effect.
std::vector<std::string> impossible_kinds(const std::vector<Refused>& refused);

// A claim that cannot be the cause hides another cause. `again` searches once more from the passed
// effects, without such kinds. Its findings are used if more effects pass and if, by `as_much`,
// they explain about as much; effects that explain far less are not the cause. The refusals of the
// first search stay in the result.
Findings without_wrong_kinds(
    Findings first,
    const std::function<Findings(Fit, const std::vector<std::string>& left_out)>& again,
    const std::function<bool(const Findings& first, const Findings& second)>& as_much);

// The passed effects with the selection's judgement. If other effects were refused beside them,
// they are judged again, because the refusals change which kinds could replace them.
Selection what_passed(const Fitter& fitter, const std::vector<Candidate>& candidates,
                      Findings found);

}  // namespace twinrate

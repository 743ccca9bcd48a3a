// What has been chosen, one after the other, in its simplest true words: sorts of friction that
// stand in for others, two lags for one, the form of a curve, a gap whose keys are those of a
// hollow beside the true one; and without what turned out too small or uncertain beside all the
// others.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

struct Settled {
  Fit fit;
  bool changed = false;  // its members, or a word or key that no refinement changes
};

Settled settle(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate

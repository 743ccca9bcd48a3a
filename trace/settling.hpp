// Simplifies a selection after its steps: kinds of friction that replace others, one lag for two,
// the form of a curve, a gap whose keys are in a local minimum beside the true one. Also drops the
// effects that are too small or too uncertain beside all the others.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

struct Settled {
  Fit fit;
  bool changed = false;  // its members, or a choice or key that no refinement changes
};

Settled settle(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate

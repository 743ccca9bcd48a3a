// Helpers for the answers of effects to the tracer: traced_keys() and materiality().
#pragma once
#include "model/drive_facts.hpp"
#include "model/effects/tracing.hpp"

namespace twinrate {

// A key whose start comes from the regression.
inline TracedKey linear_key(const char* key) {
  return {.key = key, .linear = true};
}

// machine.i_rated; 7 A if the drive file does not give it.
inline double rated_current(const DriveFacts& facts) {
  return facts.machine.i_rated > 0 ? facts.machine.i_rated : 7;
}

}  // namespace twinrate

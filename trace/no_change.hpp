// The terms that the equations balance, as the error of the prediction that nothing changes.
#pragma once
#include "trace/chain.hpp"

namespace twinrate {

// J omega_m' (Nm) and L di/dt in rotor axes (V), sampled, not whitened.
Sampled no_change(const Chain& chain);

}  // namespace twinrate

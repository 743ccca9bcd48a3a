// The gate for points (trace/point_gate.hpp) on sweeps in which the current holds the rotor. The
// points are means of neighbouring rows. Each order of the cogging and of the friction ripple is
// one claim, and Coulomb friction is another. Two halves of every sweep, its odd and even pieces
// and its two directions must agree. A refused order is not fitted beside the others as a nuisance,
// so they leave its torque in the residual.
#pragma once
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Removes the refused orders from found.holding. Does nothing if the speed judges or if no row
// does.
void refuse_orders(Found& found, const Judge& judge, const TraceHooks& hooks, TraceResult& r);

}  // namespace twinrate

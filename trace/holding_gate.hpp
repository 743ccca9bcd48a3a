// The gate for points (trace/point_gate.hpp) on sweeps in which the current holds the rotor: means
// of neighbouring rows, each order of the cogging and of the friction's ripple one claim, Coulomb
// friction another. Two halves of every sweep, odd and even pieces of it and its two directions are
// to agree. What is refused is no nuisance to the others: what it took, they leave.
#pragma once
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Takes out of found.holding what does not pass. Nothing where the speed judges or no row does.
void refuse_orders(Found& found, const Judge& judge, const TraceHooks& hooks, TraceResult& r);

}  // namespace twinrate

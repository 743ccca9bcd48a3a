// The effects that position logs show, each with its evidence, as entries of a result.
#pragma once
#include <functional>

#include "trace/considered.hpp"
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// The kinds of a holding torque: its orders, the orders of the friction, and the mean friction.
extern const char* const kOrderOfTorque;
extern const char* const kOrderOfFriction;
extern const char* const kMeanFriction;

// A claim that these logs can support, all orders of a kind together: whether a fit has it, whether
// it is large enough to be reported, and how to remove it.
struct PositionClaim {
  std::string kind;
  std::function<bool(const Found&)> found, told;
  std::function<void(Found&)> drop;
};
const std::vector<PositionClaim>& position_claims();
// Removes the claims of excluded kinds. They were fitted beside the others nevertheless, so that
// the others do not take up their part.
void drop_excluded(const Considered& considered, Found& found);

// Cogging and friction ripple, by order.
void add_periodic(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_friction(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_inertia(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// A logged speed or current with a lag.
void add_lags(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// Resistance, flux linkage and ripple of the winding's voltage.
void add_voltage(const Found& found, const DriveFacts& facts, const Considered& considered,
                 TraceResult& r);

}  // namespace twinrate

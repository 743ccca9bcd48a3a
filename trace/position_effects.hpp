// The effects that position logs show, each with what speaks for it, put into a result.
#pragma once
#include <functional>

#include "trace/considered.hpp"
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// The kinds of a holding torque: its orders, those of its friction, and its mean friction.
extern const char* const kOrderOfTorque;
extern const char* const kOrderOfFriction;
extern const char* const kMeanFriction;

// A claim that these logs can make, all orders of a kind together: whether a fit has some of it,
// whether that is large enough to be told, and how it is taken away.
struct PositionClaim {
  std::string kind;
  std::function<bool(const Found&)> found, told;
  std::function<void(Found&)> drop;
};
const std::vector<PositionClaim>& position_claims();
// Takes the claims of excluded kinds away. What they explain was fitted beside the others all the
// same, lest those take its place.
void drop_excluded(const Considered& considered, Found& found);

// Cogging and friction that ripples, by order.
void add_periodic(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_friction(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_inertia(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// A logged speed or current that comes late.
void add_lags(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// Resistance, flux linkage and ripple of the winding's voltage.
void add_voltage(const Found& found, const DriveFacts& facts, const Considered& considered,
                 TraceResult& r);

}  // namespace twinrate

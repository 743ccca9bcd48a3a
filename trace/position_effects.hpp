// The effects that position logs show, each with what speaks for it, put into a result.
#pragma once
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Cogging and friction that ripples, by order.
void add_periodic(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_friction(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
void add_inertia(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// A logged speed or current that comes late.
void add_lags(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r);
// Resistance, flux linkage and ripple of the winding's voltage.
void add_voltage(const Found& found, const DriveFacts& facts, TraceResult& r);

}  // namespace twinrate

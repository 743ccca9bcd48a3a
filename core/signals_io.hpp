// The only conversion between the loop's structs (model/signals.hpp) and their messages
// (lcmtypes/).
#pragma once
#include "core/channels.hpp"
#include "model/signals.hpp"

namespace twinrate {

measurement_t to_wire(const Measurement& m, std::int64_t session);
truth_t to_wire(const Truth& t, std::int64_t session);
estimate_t to_wire(const Estimate& e, std::int64_t session);
gain_t to_wire(const Gain& g, std::int64_t session);
reference_t to_wire(const Reference& r, std::int64_t session);
command_t to_wire(const Command& c, std::int64_t session);
// Into a reused message, whose arrays keep their memory.
void to_wire(const Estimate& e, std::int64_t session, estimate_t& w);
void to_wire(const Gain& g, std::int64_t session, gain_t& w);

Measurement from_wire(const measurement_t& w);
Truth from_wire(const truth_t& w);
Estimate from_wire(const estimate_t& w);
Gain from_wire(const gain_t& w);
Reference from_wire(const reference_t& w);
Command from_wire(const command_t& w);

}  // namespace twinrate

// The realtime pace: the plant on an absolute clock, nobody waits.
//
// At t_k: publish MEASUREMENT(k); the voltage of [t_k, t_{k+1}] is COMMAND(k - delay_samples) if it
// has arrived by t_k, otherwise the last one is held and the miss is counted with its k. A tick
// begun more than half a period late is a deadline miss. A tick begun more than a period late is a
// stall, during which the plant's clock does not advance (plant_sim/plant_clock.hpp): late ticks
// are not made up. The drive is switched off if a supervisor that was heard is silent for
// safety.supervisor_ms, without the stalls.
#pragma once
#include "core/process.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {

void run_realtime(Process& p, Plant& plant, std::int64_t steps);

// The events of the plant's state machine at tick k, on the bus.
void publish_safety_events(Process& p, const Plant& plant, std::int64_t k);

}  // namespace twinrate

// The emulated Cortex-M3 as a process of the set, instead of twinrate-estimator and twinrate-gain:
// the bridge between the channels and the link of the processor, in lock-step.
//
//   MEASUREMENT(k) -> SAMPLE(k) -> [fast step in the control interrupt] -> Answer(k) -> ESTIMATE(k)
//                                  [background below it]                -> NewGain(s) -> GAIN(s)
//
// GAIN(s) is published when the processor has finished it. A background that is late ends the run.
#pragma once
#include "embedded/cortex_device.hpp"

namespace twinrate {

// Reads the options common to all processes and runs until the end of the drive. Returns the exit
// code.
int run_cortex_process(int argc, char** argv, CortexLink link, double period_s);

}  // namespace twinrate

// Instructions and estimated cycles of every step of the filter on a Cortex-M3, counted in the
// emulator (firmware/cortex_m3/image/count_image.cpp) in two ways:
//
//   SysTick       qemu -icount shift=7, read by the image around each call
//   TCG plugin    executions of each address (firmware/cortex_m3/plugin)
//
// Both must agree in every step. Cycles are a band from the classes of the instructions (Cortex-M3
// reference manual, zero wait states):
//
//   sum of executions x class + P x taken branches,  P = 1 and the low end of each class, then 3 and
//   the high end
#pragma once
#include <string>
#include <vector>

namespace twinrate {

struct StepCount {
  std::string name;
  double instructions = 0;  // mean of a call
  int least = 0, most = 0;
  double cycles_low = 0, cycles_high = 0;
};

struct CortexCounts {
  std::string command, compiler, emulator, revision;
  std::vector<StepCount> steps;
  const StepCount& at(const std::string& name) const;  // throws std::out_of_range
};

// The reason why the images or the emulator cannot run on this machine, for example a missing
// program; "" if they can.
std::string why_no_cortex();
// Directory of the images: build/firmware/cortex_m3.
std::string cortex_directory();

// Runs both counts. Throws MachineError if the emulator is missing or fails, std::runtime_error if
// the two counts differ.
CortexCounts count_instructions();

// Low and high cycles of one instruction in the syntax of objdump, without the P of a taken branch.
struct Cycles {
  double low = 0, high = 0;
};
Cycles cycles_of(const std::string& mnemonic, const std::string& operands);

std::string to_json(const CortexCounts& counts);
// Tables 2 and 4 of Dilys 2021 beside the counts.
std::string cortex_table(const CortexCounts& counts);

}  // namespace twinrate

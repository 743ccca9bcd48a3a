// A run of the drive with the emulated Cortex-M3 as its estimator, in lock-step with the simulated
// plant. Compares it with the same filter on this machine and with the filter in double precision.
#pragma once
#include "embedded/cortex_device.hpp"

namespace twinrate {

struct CortexRun {
  bool locked = false;
  std::int64_t ticks = 0,
               equal_ticks = 0;  // equal to the host build of the same header, bit for bit
  double angle_error_rms = 0;    // rad, over [settle_s, end]
  double from_double = 0;        // largest angle difference to the double filter, rad
  double ticks_per_s = 0;        // of the wall clock
  m3::Answer last{};
  std::uint32_t log_crc = 0;  // of all answers
};

// `log`: CSV of all answers; "": none.
CortexRun run_cortex_loop(Config& config, CortexLink link, double period_s, const std::string& log);

std::string to_text(const CortexRun& run, const DriveConfig& drive, CortexLink link);

}  // namespace twinrate

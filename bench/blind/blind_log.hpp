// Simulated logs of a drive with undeclared effects, for the blind test of the tracer.
//
// The drive is niewiara2020 (B 0.002) with 12 bit over +-20 A, 8 mA noise, two current sensors, a
// 20-bit encoder with one count of noise in the log, 10 kHz.
#pragma once
#include "bench/blind/blind_case.hpp"
#include "core/config.hpp"
#include "trace/health.hpp"

namespace twinrate::blind {

struct Log {
  RawLog raw;
  // The effects of the plant, without a current limit that no row reaches: it does not change the
  // log.
  Effects truth;
};
// Simulates `duration_s`. Throws BadInput if the drive file of the case is wrong.
Log make_log(const Case& which, double duration_s = 10);
// Reads the log from directory `cache`, or simulates and stores it there. "": no cache.
Log cached_log(const Case& which, const std::string& cache);
// The drive file of the plant.
std::string plant_toml(const Case& which, double duration_s);
// The declared model.
Config declared();

}  // namespace twinrate::blind

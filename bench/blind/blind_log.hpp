// Logs of a drive with effects that nobody declared, made by the project's own plant: what the
// tracer is judged on.
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
  // The effects as they were in the plant, but for a limit that no row reaches: with it the log is
  // to the last bit what it is without.
  Effects truth;
};
// Simulates `duration_s`. Throws BadInput where the case's drive file is wrong.
Log make_log(const Case& which, double duration_s = 10);
// The same, read from directory `cache` where it is there, else kept there; no cache where empty.
Log cached_log(const Case& which, const std::string& cache);
// The drive file of the plant that makes it.
std::string plant_toml(const Case& which, double duration_s);
// The declared model.
Config declared();

}  // namespace twinrate::blind

// Logs of a drive with effects that nobody declared, made by the project's own plant: what the
// tracer is judged on.
//
// The drive is niewiara2020 (B 0.002) with 12 bit over +-20 A, 8 mA noise, two current sensors, a
// 20-bit encoder with one count of noise in the log, 10 kHz. Profiles:
//   rich   speeds -800 to 900 rpm, loads to 4 Nm, i_d of both signs
//   slow   10 to 50 rpm
//   moves  the same point-to-point move again and again
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "trace/health.hpp"

namespace twinrate::blind {

struct Case {
  std::string name;     // "single-cogging-3"
  std::string profile;  // rich, slow, moves
  std::uint64_t seed = 1;
  std::vector<std::string> kinds;  // true set
  std::string effects_toml;        // [[effect]] tables
};

// `kinds` drawn from the ranges of the catalogue with `seed`.
Case make_case(const std::string& profile, const std::vector<std::string>& kinds,
               std::uint64_t seed);
// Every kind that make_case() can draw.
const std::vector<std::string>& drawable_kinds();

struct Log {
  RawLog raw;
  Effects truth;  // the effects as they were in the plant
};
// Simulates `duration_s`. Throws BadInput where the case's drive file is wrong.
Log make_log(const Case& which, double duration_s = 10);
// The declared model.
Config declared();

}  // namespace twinrate::blind

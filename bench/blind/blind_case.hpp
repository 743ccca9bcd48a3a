// A case of the blind test: effects of random size and a profile.
//
// Profiles:
//   rich   speeds -800 to 900 rpm, loads to 4 Nm, i_d of both signs
//   slow   10 to 50 rpm
//   moves  repetitions of one point-to-point move
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace twinrate::blind {

struct Case {
  std::string name;     // "single-cogging-3"
  std::string profile;  // rich, slow, moves
  std::uint64_t seed = 1;
  std::vector<std::string> kinds;  // true effects
  std::string effects_toml;        // [[effect]] tables
};

// Draws the parameters of `kinds` from the ranges of the catalogue with `seed`.
Case make_case(const std::string& profile, const std::vector<std::string>& kinds,
               std::uint64_t seed);
// The kinds of make_case(), without dc_bus_ripple.
const std::vector<std::string>& drawable_kinds();

// Overrides of niewiara2020 for the drive and the profile of a case, as "key=value".
std::vector<std::string> overrides(const Case& which, double duration_s);

}  // namespace twinrate::blind

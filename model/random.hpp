// Noise as a pure function of (seed, stream, index): the same sample whatever ran before it.
//
// SplitMix64 finaliser as a counter-based generator, Box-Muller for the normal deviate.
#pragma once
#include <cmath>
#include <cstdint>
#include <numbers>

#include "model/math.hpp"

namespace twinrate {

inline std::uint64_t splitmix64(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

// Uniform in (0, 1].
inline double uniform(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  const std::uint64_t bits = splitmix64(splitmix64(splitmix64(seed) ^ stream) ^ index);
  return static_cast<double>((bits >> 11) + 1) * 0x1.0p-53;
}

// Standard normal deviate.
inline double normal(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  const double u1 = uniform(seed, 2 * stream, index), u2 = uniform(seed, 2 * stream + 1, index);
  return std::sqrt(-2 * math::log(u1)) * math::cos(2 * std::numbers::pi * u2);
}

}  // namespace twinrate

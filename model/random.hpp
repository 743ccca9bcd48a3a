// Noise as a pure function of (seed, stream, index): the same sample independent of earlier calls.
//
// SplitMix64 finaliser as a counter-based generator, Box-Muller for the normal deviate.
#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "model/math.hpp"

namespace twinrate {

// z: std::uint64_t, or FourBits.
template <class Bits>
[[gnu::always_inline]] inline void mix_bits(Bits& z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  z ^= z >> 31;
}
inline std::uint64_t splitmix64(std::uint64_t z) {
  mix_bits(z);
  return z;
}

// Uniform in (0, 1].
class Uniform {
 public:
  Uniform(std::uint64_t seed, std::uint64_t stream) : key_(splitmix64(splitmix64(seed) ^ stream)) {}
  double operator()(std::uint64_t index) const {
    return static_cast<double>((splitmix64(key_ ^ index) >> 11) + 1) * 0x1.0p-53;
  }
  std::uint64_t key() const { return key_; }

 private:
  std::uint64_t key_;
};
inline double uniform(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  return Uniform(seed, stream)(index);
}

// Standard normal deviate.
class Normal {
 public:
  Normal(std::uint64_t seed, std::uint64_t stream)
      : u1_(seed, 2 * stream), u2_(seed, 2 * stream + 1) {}
  double operator()(std::uint64_t index) const {
    return std::sqrt(-2 * math::log(u1_(index))) *
           math::sincos(2 * std::numbers::pi * u2_(index)).cos;
  }

 private:
  Uniform u1_, u2_;
};

// Three streams, `first` and the next two, at one index: bit for bit those of Normal. Four
// neighbouring indices are made together, those of one stream in one vector, and kept for the calls
// that follow.
class ThreeNormals {
 public:
  ThreeNormals(std::uint64_t seed, std::uint64_t first) {
    for (std::size_t i = 0; i < 3; ++i) {
      u1_keys_[i] = Uniform(seed, 2 * (first + i)).key();
      u2_keys_[i] = Uniform(seed, 2 * (first + i) + 1).key();
    }
  }
  std::array<double, 3> operator()(std::uint64_t index) {
    if (index / kLanes != four_ || !made_) make(index / kLanes);
    const double* at = normals_.data() + index % kLanes;
    return {at[0], at[kLanes], at[2 * kLanes]};
  }

 private:
  void make(std::uint64_t four);

  std::array<std::uint64_t, 3> u1_keys_, u2_keys_;
  bool made_ = false;
  std::uint64_t four_ = 0;                    // normals_ are of 4 four_ and the next three
  std::array<double, 3 * kLanes> normals_{};  // stream by stream
};

inline double normal(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  return Normal(seed, stream)(index);
}

}  // namespace twinrate

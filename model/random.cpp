#include "model/random.hpp"

namespace twinrate {
namespace {

// At index, index + 1, ..
[[gnu::always_inline]] inline void uniform(std::uint64_t key, std::uint64_t index, Four& u) {
  FourBits bits = FourBits{index, index + 1, index + 2, index + 3} ^ key;
  mix_bits(bits);
  const FourBits whole = (bits >> 11) + 1, zero = __builtin_bit_cast(FourBits, Four{} + 0x1p52);
  const Four high = __builtin_bit_cast(Four, (whole >> 26) | zero) - 0x1p52;
  const Four low = __builtin_bit_cast(Four, (whole & 0x3ffffff) | zero) - 0x1p52;
  u = (high * 0x1p26 + low) * 0x1.0p-53;
}
[[gnu::always_inline]] inline void normal(std::uint64_t u1_key, std::uint64_t u2_key,
                                          std::uint64_t index, double* out) {
  Four uniform_1, uniform_2;
  uniform(u1_key, index, uniform_1);
  uniform(u2_key, index, uniform_2);
  Four log;
  math::log_of(math::octave_of(uniform_1), 0, log);
  const Four angle = 2 * std::numbers::pi * uniform_2;
  const Four cos = math::sincos_of(math::quarter_turns_near(angle)).cos;
  for (int l = 0; l < kLanes; ++l) out[l] = std::sqrt(-2 * log[l]) * cos[l];
}

using Keys = std::array<std::uint64_t, 3>;
[[gnu::always_inline]] inline void three(const Keys& u1, const Keys& u2, std::uint64_t index,
                                         double* out) {
  for (std::size_t i = 0; i < 3; ++i) normal(u1[i], u2[i], index, out + i * kLanes);
}
__attribute__((target("avx2"))) void three_avx2(const Keys& u1, const Keys& u2, std::uint64_t index,
                                                double* out) {
  three(u1, u2, index, out);
}

}  // namespace

void ThreeNormals::make(std::uint64_t four) {
  const std::uint64_t index = four * kLanes;
  (has_avx2() ? three_avx2 : three)(u1_keys_, u2_keys_, index, normals_.data());
  four_ = four;
  made_ = true;
}

}  // namespace twinrate

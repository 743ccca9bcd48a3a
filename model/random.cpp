#include "model/random.hpp"

namespace twinrate {
namespace {

using Keys = std::array<std::uint64_t, 3>;
using Numbers = std::array<double, 3>;

[[gnu::always_inline]] inline void uniform(const Keys& keys, std::uint64_t index, Four& u) {
  FourBits bits = FourBits{keys[0], keys[1], keys[2]} ^ index;  // the fourth lane is spare
  mix_bits(bits);
  const FourBits whole = (bits >> 11) + 1, zero = __builtin_bit_cast(FourBits, Four{} + 0x1p52);
  const Four high = __builtin_bit_cast(Four, (whole >> 26) | zero) - 0x1p52;
  const Four low = __builtin_bit_cast(Four, (whole & 0x3ffffff) | zero) - 0x1p52;
  u = (high * 0x1p26 + low) * 0x1.0p-53;
}
[[gnu::always_inline]] inline Numbers normal(const Keys& u1, const Keys& u2, std::uint64_t index) {
  Four uniform_1, uniform_2;
  uniform(u1, index, uniform_1);
  uniform(u2, index, uniform_2);
  Four log;
  math::log_of(math::octave_of(uniform_1), 0, log);
  const Four angle = 2 * std::numbers::pi * uniform_2;
  const Four cos = math::sincos_of(math::quarter_turns_near(angle)).cos;
  Numbers out;
  for (int l = 0; l < 3; ++l) out[static_cast<std::size_t>(l)] = std::sqrt(-2 * log[l]) * cos[l];
  return out;
}

__attribute__((target("avx2"))) Numbers avx2(const Keys& u1, const Keys& u2, std::uint64_t index) {
  return normal(u1, u2, index);
}
Numbers portable(const Keys& u1, const Keys& u2, std::uint64_t index) {
  return normal(u1, u2, index);
}

}  // namespace

std::array<double, 3> ThreeNormals::operator()(std::uint64_t index) const {
  return has_avx2() ? avx2(u1_keys_, u2_keys_, index) : portable(u1_keys_, u2_keys_, index);
}

}  // namespace twinrate

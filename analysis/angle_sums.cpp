#include "analysis/angle_sums.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <utility>

#include "model/four.hpp"
#include "model/frames.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;

constexpr int kPowers = 16;
constexpr double kFurthest = 0.8;  // M h

// For one angle of the grid, over the samples nearest to it: sum w d^p, sum w y d^p.
// A Four is aligned to 16 bytes in code for any machine, but code for AVX2 needs 32.
struct alignas(sizeof(Four)) Moments {
  Four weights[kPowers / kLanes]{}, values[kPowers / kLanes]{};
};

struct Samples {
  std::span<const double> theta, w, y;
};

// pi/2 in two parts, as in math::quarter_turns_near().
constexpr double kQuarterTurn = 0x1.921fb544p0, kQuarterTurnRest = 0x1.0b4611a626331p-34;

[[gnu::always_inline]] inline void gather(const Samples& samples, std::vector<Moments>& grid) {
  const auto G = static_cast<double>(grid.size());
  const double step = kQuarterTurn * (4 / G), step_rest = kQuarterTurnRest * (4 / G);
  for (std::size_t i = 0; i < samples.theta.size(); ++i) {
    const double theta = samples.theta[i];
    const double shifted = theta * (G / kTwoPi) + 0x1.8p52, k = shifted - 0x1.8p52;
    const double d = ((theta - k * step) - k * step_rest) * (G / kPi), d2 = d * d, d4 = d2 * d2;
    Moments& at = grid[std::bit_cast<std::uint64_t>(shifted) & (grid.size() - 1)];
    Four power = samples.w[i] * Four{1, d, d2, d2 * d};
    for (int p = 0; p < kPowers / kLanes; ++p) {
      at.weights[p] += power;
      at.values[p] += samples.y[i] * power;
      power *= d4;
    }
  }
}
__attribute__((target("avx2"))) void gather_avx2(const Samples& samples,
                                                 std::vector<Moments>& grid) {
  gather(samples, grid);
}

// e^(j 2 pi k/G), k < G/2.
std::vector<Complex> roots_of_one(std::size_t G) {
  std::vector<Complex> roots(G / 2);
  for (std::size_t k = 0; k < roots.size(); ++k)
    roots[k] = math::polar(1, kTwoPi * static_cast<double>(k) / static_cast<double>(G));
  return roots;
}

// c_m <- sum_g c_g e^(j 2 pi m g/G), by halves.
void transform(std::vector<Complex>& c, const std::vector<Complex>& roots) {
  const std::size_t G = c.size();
  for (std::size_t i = 1, reversed = 0; i < G; ++i) {
    std::size_t bit = G / 2;
    for (; reversed & bit; bit /= 2) reversed ^= bit;
    reversed ^= bit;
    if (i < reversed) std::swap(c[i], c[reversed]);
  }
  for (std::size_t half = 1; half < G; half *= 2)
    for (std::size_t first = 0; first < G; first += 2 * half)
      for (std::size_t i = first; i < first + half; ++i) {
        const Complex odd = roots[(i - first) * (G / 2 / half)] * c[i + half];
        c[i + half] = c[i] - odd;
        c[i] += odd;
      }
}

}  // namespace

AngleSums angle_sums(std::span<const double> theta, std::span<const double> w,
                     std::span<const double> y, int M) {
  assert(w.size() == theta.size() && y.size() == theta.size() && M >= 0);
  const auto orders = static_cast<std::size_t>(M) + 1;
  const auto G = std::bit_ceil(static_cast<std::size_t>(std::ceil(M * kPi / kFurthest)) + 2);
  std::vector<Moments> grid(G);
  const Samples samples{theta, w, y};
  has_avx2() ? gather_avx2(samples, grid) : gather(samples, grid);

  const std::vector<Complex> roots = roots_of_one(G);
  AngleSums sums{std::vector<Complex>(orders), std::vector<Complex>(orders)};
  std::vector<Complex> factors(orders, 1.0), c(G);  // (j m h)^p/p!
  for (int p = 0; p < kPowers; ++p) {
    // The moments are real, so one transform covers both: one as the real part, the other as the
    // imaginary part.
    std::transform(grid.begin(), grid.end(), c.begin(), [p](const Moments& at) {
      return Complex(at.weights[p / kLanes][p % kLanes], at.values[p / kLanes][p % kLanes]);
    });
    transform(c, roots);
    for (std::size_t m = 0; m < orders; ++m) {
      const Complex one = 0.5 * c[m], other = 0.5 * std::conj(c[(G - m) % G]), apart = one - other;
      sums.weights[m] += factors[m] * (one + other);
      sums.values[m] += factors[m] * Complex(apart.imag(), -apart.real());
      const double turned = static_cast<double>(m) * kPi / static_cast<double>(G) / (p + 1);
      factors[m] = Complex(-factors[m].imag(), factors[m].real()) * turned;
    }
  }
  return sums;
}

}  // namespace twinrate

// Four numbers side by side. Each operation is the same on every machine, bit for bit. A machine
// with AVX2 does it in one instruction if the function around it is compiled for that
// (__attribute__((target("avx2"))), chosen by has_avx2()), other machines in two.
#pragma once
#include <cstddef>
#include <cstring>

namespace twinrate {

constexpr int kLanes = 4;
typedef double Four __attribute__((vector_size(8 * kLanes)));
typedef unsigned long long FourBits __attribute__((vector_size(8 * kLanes)));
typedef long long FourTruths __attribute__((vector_size(8 * kLanes)));

inline bool has_avx2() {
  static const bool has = __builtin_cpu_supports("avx2");
  return has;
}

// sum_j a[j] b[j]
__attribute__((always_inline)) inline double dot_by_fours(const double* a, const double* b,
                                                          std::size_t n) {
  const auto add = [&](std::size_t j, Four & sum) __attribute__((always_inline)) {
    Four x, y;
    std::memcpy(&x, a + j, sizeof x);
    std::memcpy(&y, b + j, sizeof y);
    sum += x * y;
  };
  Four even{}, odd{};
  std::size_t j = 0;
  for (; j + 2 * kLanes <= n; j += 2 * kLanes) {
    add(j, even);
    add(j + kLanes, odd);
  }
  if (j + kLanes <= n) {
    add(j, even);
    j += kLanes;
  }
  even += odd;
  double sum = (even[0] + even[1]) + (even[2] + even[3]);
  for (; j < n; ++j) sum += a[j] * b[j];
  return sum;
}

}  // namespace twinrate

// A row of N numbers in a vector register: one number of each of N drives.
//
// Code for a type T with + - * / also runs on Lanes. Each operation acts on every lane separately
// and is the same IEEE operation for every N (no contraction, no reciprocal estimates). The result
// of a lane is therefore equal to that of N = 1, bit for bit.
//
// `Isa` gives the translation units of different instruction sets different symbols.
#pragma once
#include <immintrin.h>

#include <cstdint>
#include <cstring>

namespace twinrate::lanes {

template <int N>
struct Register {
  typedef double Numbers __attribute__((vector_size(8 * N)));
  typedef std::uint64_t Bits __attribute__((vector_size(8 * N)));
  typedef std::int64_t Truths __attribute__((vector_size(8 * N)));
};
template <>
struct Register<1> {
  using Numbers = double;
  using Bits = std::uint64_t;
  using Truths = bool;
};

// x y + z with one rounding. Without the FMA instruction the library computes the same result
// slowly.
template <int N>
typename Register<N>::Numbers fused(typename Register<N>::Numbers x,
                                    typename Register<N>::Numbers y,
                                    typename Register<N>::Numbers z) {
  if constexpr (N == 1) {
    return __builtin_fma(x, y, z);
#ifdef __AVX512F__
  } else if constexpr (N == 8) {
    return typename Register<N>::Numbers(_mm512_fmadd_pd(__m512d(x), __m512d(y), __m512d(z)));
#endif
#ifdef __FMA__
  } else if constexpr (N == 4) {
    return typename Register<N>::Numbers(_mm256_fmadd_pd(__m256d(x), __m256d(y), __m256d(z)));
#endif
  } else {
    typename Register<N>::Numbers sum = z;
    for (int lane = 0; lane < N; ++lane) sum[lane] = __builtin_fma(x[lane], y[lane], z[lane]);
    return sum;
  }
}

template <int N_, class Isa>
struct Lanes {
  static constexpr int N = N_;
  using Numbers = typename Register<N>::Numbers;
  using Bits = typename Register<N>::Bits;
  using Mask = typename Register<N>::Truths;
  Numbers v;

  Lanes() = default;
  Lanes(double number) : v(number - Numbers{}) {}  // x - 0 is x, -0 included
  static Lanes of(Numbers numbers) {
    Lanes lanes;
    lanes.v = numbers;
    return lanes;
  }
  static Lanes of_bits(Bits bits) {
    Lanes lanes;
    std::memcpy(&lanes.v, &bits, sizeof bits);
    return lanes;
  }
  Bits bits() const {
    Bits b;
    std::memcpy(&b, &v, sizeof b);
    return b;
  }

  // A product before rounding: its sum with a number is one fused operation.
  struct Product {
    Numbers x, y;
    operator Lanes() const { return of(x * y); }
  };

  friend Product operator*(Lanes x, Lanes y) { return {x.v, y.v}; }
  friend Lanes operator/(Lanes x, Lanes y) { return of(x.v / y.v); }
  friend Lanes operator+(Lanes x, Lanes y) { return of(x.v + y.v); }
  friend Lanes operator+(Product p, Lanes z) { return of(fused<N>(p.x, p.y, z.v)); }
  friend Lanes operator+(Lanes z, Product p) { return of(fused<N>(p.x, p.y, z.v)); }
  friend Lanes operator+(Product p, Product q) { return of(fused<N>(p.x, p.y, q.x * q.y)); }
  friend Lanes operator-(Lanes x, Lanes y) { return of(x.v - y.v); }
  friend Lanes operator-(Product p, Lanes z) { return of(fused<N>(p.x, p.y, -z.v)); }
  friend Lanes operator-(Lanes z, Product p) { return of(fused<N>(-p.x, p.y, z.v)); }
  friend Lanes operator-(Product p, Product q) { return of(fused<N>(p.x, p.y, -(q.x * q.y))); }
  friend Lanes operator-(Lanes x) { return of(-x.v); }
  friend Product operator-(Product p) { return {-p.x, p.y}; }
  Lanes& operator+=(Lanes y) { return *this = *this + y; }
  Lanes& operator+=(Product p) { return *this = *this + p; }
  Lanes& operator-=(Lanes y) { return *this = *this - y; }

  friend Mask operator<(Lanes x, Lanes y) { return x.v < y.v; }
  friend Mask operator>(Lanes x, Lanes y) { return x.v > y.v; }
  friend Mask operator<=(Lanes x, Lanes y) { return x.v <= y.v; }
  friend Mask operator>=(Lanes x, Lanes y) { return x.v >= y.v; }
  friend Mask operator==(Lanes x, Lanes y) { return x.v == y.v; }
  friend Mask operator!=(Lanes x, Lanes y) { return x.v != y.v; }
};

template <class T>
T select(typename T::Mask mask, T yes, T no) {
  return T::of(mask ? yes.v : no.v);
}
template <class T>
T min(T x, T y) {
  return select(x < y, x, y);
}
template <class T>
T max(T x, T y) {
  return select(x > y, x, y);
}
template <class T>
T abs(T x) {
  return T::of_bits(x.bits() & 0x7fffffffffffffffu);
}

template <class T>
bool any(typename T::Mask mask) {
  if constexpr (T::N == 1) {
    return mask;
#ifdef __AVX512DQ__
  } else if constexpr (T::N == 8) {
    return _mm512_movepi64_mask(__m512i(mask)) != 0;
#endif
#ifdef __AVX__
  } else if constexpr (T::N == 4) {
    return _mm256_movemask_pd(__m256d(mask)) != 0;
#endif
  } else {
    bool some = false;
    for (int lane = 0; lane < T::N; ++lane) some |= mask[lane] != 0;
    return some;
  }
}
template <class T>
bool in_lane(typename T::Mask mask, int lane) {
  if constexpr (T::N == 1)
    return mask;
  else
    return mask[lane] != 0;
}

template <class T>
T sqrt(T x) {
  if constexpr (T::N == 1) {
    return T::of(_mm_cvtsd_f64(_mm_sqrt_sd(_mm_setzero_pd(), _mm_set_sd(x.v))));
  } else if constexpr (T::N == 2) {
    return T::of(typename T::Numbers(_mm_sqrt_pd(__m128d(x.v))));
#ifdef __AVX__
  } else if constexpr (T::N == 4) {
    return T::of(typename T::Numbers(_mm256_sqrt_pd(__m256d(x.v))));
#endif
#ifdef __AVX512F__
  } else if constexpr (T::N == 8) {
    return T::of(typename T::Numbers(_mm512_maskz_sqrt_pd(0xff, __m512d(x.v))));
#endif
  }
}

}  // namespace twinrate::lanes

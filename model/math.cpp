#include "model/math.hpp"

#include <limits>

namespace twinrate::math {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The binary digits of 2/pi, 64 a word, after one word of zeros.
constexpr std::uint64_t kTwoOverPi[] = {
    0,
    0xa2f9836e4e441529,
    0xfc2757d1f534ddc0,
    0xdb6295993c439041,
    0xfe5163abdebbc561,
    0xb7246e3a424dd2e0,
    0x06492eea09d1921c,
    0xfe1deb1cb129a73e,
    0xe88235f52ebb4484,
    0xe99c7026b45f7e41,
    0x3991d639835339f4,
    0x9c845f8bbdf9283b,
    0x1ff897ffde05980f,
    0xef2f118b5a0a6d1f,
    0x6d367ecf27cb09b7,
    0x4f463f669e5fea2d,
    0x7527bac7ebe5f17b,
    0x3d0739f78a5292ea,
    0x6bfb5fb11f8d5d08,
    0x56033046fc7b6bab,
};

// 64 digits from digit `at` on.
std::uint64_t digits(int at) {
  const int word = at / 64, bit = at % 64;
  const std::uint64_t upper = kTwoOverPi[word] << bit;
  return bit == 0 ? upper : upper | kTwoOverPi[word + 1] >> (64 - bit);
}

// x 2^k; the product is rounded once if the result is subnormal.
double scaled(double x, int k) {
  const auto power = [](int n) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(1023 + n) << 52);
  };
  if (k > 1023) return x * power(1023) * power(k - 1023);
  if (k < -1022) return x * power(k + 1022) * power(-1022);
  return x * power(k);
}

// x = k ln 2 + hi - lo
struct Octaves {
  double hi, lo;
  int k;
};
Octaves octaves(double x) {
  const double k = (x * 0x1.71547652b82fep+0 + 0x1.8p52) - 0x1.8p52;  // 1/ln 2
  return {x - k * kLn2, k * kLn2Rest, static_cast<int>(k)};
}

// Of every x > 0.
OctaveOf<double> octave_of_any(double x) {
  if (x >= 0x1p-1022) return octave_of(x);
  const auto [k, f] = octave_of(x * 0x1p54);
  return {k - 54, f};
}

}  // namespace

// x = m 2^e with a whole m. The digits of 2/pi before digit e - 2 give whole turns; the next 192
// give the quarter turns in the two highest bits of their product with m.
QuarterTurns quarter_turns_far(double x) {
  if (!std::isfinite(x)) return {kNan, kNan, 0};
  using Wide = unsigned __int128;
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
  const std::uint64_t m = (bits & 0x000fffffffffffff) | 0x0010000000000000;
  const int first = static_cast<int>(bits >> 52 & 0x7ff) - 1075 + 62;
  const Wide low = Wide{m} * digits(first + 128);
  const Wide middle = Wide{m} * digits(first + 64) + (low >> 64);
  const Wide turned = (Wide{m * digits(first)} << 64) + middle;  // of 2^128: a turn
  const auto part = static_cast<__int128>(turned << 2);          // of 2^128: a quarter turn
  const std::uint64_t k = static_cast<std::uint64_t>(turned >> 126) + (part < 0);
  const long double angle =
      static_cast<long double>(part) * 0x1p-128L * 0xc.90fdaa22168c235p-3L;  // pi/2
  const auto r = static_cast<double>(angle);
  const auto tail = static_cast<double>(angle - r);
  if (x < 0) return {-r, -tail, ~k + 1};
  return {r, tail, k};
}

double sin(double x) {
  return sincos(x).sin;
}
double cos(double x) {
  return sincos(x).cos;
}

double exp(double x) {
  if (x > 709.782712893384) return kInf;
  if (x < -745.1332191019412) return 0;
  if (std::isnan(x)) return x;
  const auto [hi, lo, k] = octaves(x);
  const double r = hi - lo, z = r * r;
  const double c = r - z * (0x1.555555555553ep-3 +
                            z * (-0x1.6c16c16bebd93p-9 +
                                 z * (0x1.1566aaf25de2cp-14 +
                                      z * (-0x1.bbd41c5d26bf1p-20 + z * 0x1.6376972bea4dp-25))));
  return scaled(1 - ((lo - r * c / (2 - c)) - hi), k);
}

double expm1(double x) {
  if (x > 709.782712893384) return kInf;
  if (x < -50) return -1;
  if (std::isnan(x) || x == 0) return x;
  const auto [hi, lo, k] = octaves(x);
  const double r = hi - lo, rest = (hi - r) - lo, half = 0.5 * r, z = r * half;
  const double r1 = 1 + z * (-0x1.11111111110f4p-5 +
                             z * (0x1.a01a019fe5585p-10 +
                                  z * (-0x1.4ce199eaadbb7p-14 +
                                       z * (0x1.0cfca86e65239p-18 + z * -0x1.afdb76e09c32dp-23))));
  const double t = 3 - r1 * half, q = z * ((r1 - t) / (6 - r * t));
  if (k == 0) return r - (r * q - z);
  const double e = (r * (q - rest) - rest) - z;
  if (k == -1) return 0.5 * (r - e) - 0.5;
  if (k == 1) return r < -0.25 ? -2 * (e - (r + 0.5)) : 1 + 2 * (r - e);
  if (k <= -2 || k > 56) return scaled(1 - (e - r), k) - 1;
  const double small = scaled(1, -k);
  if (k < 20) return scaled((1 - small) - (e - r), k);
  return scaled((r - (e + small)) + 1, k);
}

double log(double x) {
  if (x == 0) return -kInf;
  if (x < 0) return kNan;
  if (!(x < kInf)) return x;
  double log_x = 0;
  log_of(octave_of_any(x), 0, log_x);
  return log_x;
}

double log1p(double x) {
  if (x == -1) return -kInf;
  if (x < -1) return kNan;
  if (!(x < kInf) || x == 0) return x;
  const double u = 1 + x;
  const double lost = x > 1 ? 1 - (u - x) : x - (u - 1);  // of the sum
  if (u == 1) return x;
  double log_x = 0;
  log_of(octave_of_any(u), lost / u, log_x);
  return log_x;
}

double pow(double x, double y) {
  if (y == 0 || x == 1) return 1;
  if (x == 0) return y > 0 ? 0 : kInf;
  return exp(y * log(x));
}

double tanh(double x) {
  if (std::isnan(x)) return x;
  const double size = std::abs(x);
  if (size > 22) return std::copysign(1, x);
  if (size < 0x1p-28) return x;
  const double t = expm1(size < 1 ? -2 * size : 2 * size);
  return std::copysign(size < 1 ? -t / (t + 2) : 1 - 2 / (t + 2), x);
}

double atan(double x) {
  constexpr double kAngle[] = {0, 0x1.dac670561bb4fp-2, 0x1.921fb54442d18p-1, 0x1.f730bd281f69bp-1,
                               0x1.921fb54442d18p+0};
  constexpr double kRest[] = {0, 0x1.a2b7f222f65e2p-56, 0x1.1a62633145c07p-55,
                              0x1.007887af0cbbdp-56, 0x1.1a62633145c07p-54};
  if (std::isnan(x)) return x;
  double t = std::abs(x);
  int near = 0;  // atan 1/2, 1, 3/2, infinity
  if (t >= 39.0 / 16) {
    near = 4;
    t = -1 / t;
  } else if (t >= 19.0 / 16) {
    near = 3;
    t = (t - 1.5) / (1 + 1.5 * t);
  } else if (t >= 11.0 / 16) {
    near = 2;
    t = (t - 1) / (t + 1);
  } else if (t >= 7.0 / 16) {
    near = 1;
    t = (2 * t - 1) / (2 + t);
  }
  const double z = t * t, w = z * z;
  const double s1 = z * (0x1.555555555550dp-2 +
                         w * (0x1.24924920083ffp-3 +
                              w * (0x1.745cdc54c206ep-4 +
                                   w * (0x1.10d66a0d03d51p-4 +
                                        w * (0x1.97b4b24760debp-5 + w * 0x1.0ad3ae322da11p-6)))));
  const double s2 =
      w *
      (-0x1.999999998ebc4p-3 +
       w * (-0x1.c71c6fe231671p-4 +
            w * (-0x1.3b0f2af749a6dp-4 + w * (-0x1.dde2d52defd9ap-5 + w * -0x1.2b4442c6a6c2fp-5))));
  const double angle =
      near == 0 ? t - t * (s1 + s2) : kAngle[near] - ((t * (s1 + s2) - kRest[near]) - t);
  return std::copysign(angle, x);
}

double atan2(double y, double x) {
  constexpr double kPi = 0x1.921fb54442d18p+1, kPiRest = 0x1.1a62633145c07p-53;
  if (std::isnan(x) || std::isnan(y)) return kNan;
  const bool both_infinite = std::isinf(x) && std::isinf(y);
  if (y != 0 && !both_infinite && (x == 0 || std::isinf(y))) return std::copysign(kPi / 2, y);
  double angle = 0;  // of |y|, |x|
  if (both_infinite)
    angle = kPi / 4;
  else if (y != 0)
    angle = atan(std::abs(y) / std::abs(x));
  if (std::signbit(x)) angle = kPi - (angle - kPiRest);
  return std::copysign(angle, y);
}

double asin(double x) {
  return atan2(x, std::sqrt((1 - x) * (1 + x)));
}

}  // namespace twinrate::math

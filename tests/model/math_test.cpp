// The product's own elementary functions against the library's in extended precision.
#include "model/math.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>

#include "model/random.hpp"
#include "model/rotor_axes.hpp"

namespace twinrate {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr int kSamples = 20000;

using Own = double (*)(double);
using Library = long double (*)(long double);

// Largest error in units of the last place of the result, over arguments in [low, high]; in
// logarithmic steps where `low` is above zero and far below `high`.
double largest_error(Own own, Library exact, double low, double high) {
  double largest = 0;
  const bool in_octaves = low > 0 && high > 100 * low;
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double share = uniform(1, 0, i);
    const double x = in_octaves ? low * std::pow(high / low, share) : low + (high - low) * share;
    const long double y = exact(x);
    const double size = std::abs(static_cast<double>(y));
    const double unit = std::nextafter(size, kInf) - size;
    largest = std::max(largest, static_cast<double>(std::abs(own(x) - y)) / unit);
  }
  return largest;
}

struct Case {
  const char* name;
  Own own;
  Library exact;
  double low, high, units;
};

TEST(Math, IsWithinTheUnitsOfTheLastPlaceThatItsHeaderStates) {
  const auto sinl = [](long double x) { return std::sin(x); };
  const auto cosl = [](long double x) { return std::cos(x); };
  const auto expl = [](long double x) { return std::exp(x); };
  const auto expm1l = [](long double x) { return std::expm1(x); };
  const auto logl = [](long double x) { return std::log(x); };
  const auto log1pl = [](long double x) { return std::log1p(x); };
  const auto tanhl = [](long double x) { return std::tanh(x); };
  const auto atanl = [](long double x) { return std::atan(x); };
  const auto asinl = [](long double x) { return std::asin(x); };
  const Case cases[] = {
      {"sin", math::sin, sinl, -10, 10, 1},
      {"sin far", math::sin, sinl, 10, 9e5, 1},
      {"sin beyond three parts", math::sin, sinl, 1e6, 1e15, 1},
      {"cos", math::cos, cosl, -10, 10, 1},
      {"cos far", math::cos, cosl, 10, 9e5, 1},
      {"cos beyond three parts", math::cos, cosl, 1e6, 1e15, 1},
      {"exp", math::exp, expl, -700, 700, 1},
      {"exp near zero", math::exp, expl, -1, 1, 1},
      {"expm1", math::expm1, expm1l, -40, 100, 1},
      {"expm1 near zero", math::expm1, expm1l, -1, 1, 1},
      {"log", math::log, logl, 1e-150, 1e150, 1},
      {"log near one", math::log, logl, 0.5, 2, 1},
      {"log1p", math::log1p, log1pl, -0.99, 5, 2},
      {"log1p near zero", math::log1p, log1pl, 1e-20, 0.5, 2},
      {"tanh", math::tanh, tanhl, -5, 5, 3},
      {"tanh near zero", math::tanh, tanhl, 1e-12, 0.5, 3},
      {"atan", math::atan, atanl, -5, 5, 1},
      {"atan far", math::atan, atanl, 1e-10, 1e10, 1},
      {"asin", math::asin, asinl, -1, 1, 3},
  };
  for (const Case& c : cases) {
    const double error = largest_error(c.own, c.exact, c.low, c.high);
    EXPECT_LT(error, c.units) << c.name;
    EXPECT_GT(error, 0.49) << c.name << ": nothing was compared";
  }
}

// A vector is turned back with the sine and cosine that turned it: model/rotor_axes.hpp.
TEST(Math, SineIsOddAndCosineIsEvenBitForBit) {
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double x = std::exp(60 * uniform(9, 0, i) - 20);
    const auto there = math::sincos(x), back = math::sincos(-x);
    ASSERT_EQ(back.sin, -there.sin) << x;
    ASSERT_EQ(back.cos, there.cos) << x;
    ASSERT_EQ(RotorAxes(x).of(x).sin, there.sin);
    ASSERT_EQ(RotorAxes(1.5).of(x).cos, there.cos);
  }
}

TEST(Math, SineAndCosineAreWithin1e16OfAnyArgument) {
  double worst = 0;
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double x = (i % 2 ? 1 : -1) * std::pow(10, 40 * uniform(2, 0, i) - 20);
    const auto at = math::sincos(x);
    worst = std::max({worst, static_cast<double>(std::abs(at.sin - sinl(x))),
                      static_cast<double>(std::abs(at.cos - cosl(x)))});
  }
  EXPECT_LT(worst, 1e-16);
  EXPECT_GT(worst, 0.5e-16);
}

TEST(Math, ArctangentOfTwoIsTheLibrarysInEveryQuadrantAndOnTheAxes) {
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double y = uniform(3, 0, i) - 0.5, x = uniform(3, 1, i) - 0.5;
    ASSERT_NEAR(math::atan2(y, x), std::atan2(y, x), 5e-16) << y << " " << x;
  }
  for (const double y : {0.0, -0.0, 1.0, -1.0, kInf, -kInf})
    for (const double x : {0.0, -0.0, 1.0, -1.0, kInf, -kInf}) {
      EXPECT_EQ(math::atan2(y, x), std::atan2(y, x)) << y << " " << x;
      EXPECT_EQ(std::signbit(math::atan2(y, x)), std::signbit(std::atan2(y, x))) << y << " " << x;
    }
}

TEST(Math, PowersAreRightToTheSizeOfTheirExponent) {
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double x = 5 * uniform(4, 0, i), y = 4 * uniform(4, 1, i) - 2;
    const double exact = std::pow(x, y);
    ASSERT_NEAR(math::pow(x, y), exact, 4e-16 * (1 + std::abs(std::log(exact))) * exact);
  }
  EXPECT_EQ(math::pow(0, 1.5), 0);
  EXPECT_EQ(math::pow(0, 0), 1);
}

TEST(Math, RoundIsThatOfTheLibrary) {
  const double below_half = std::nextafter(0.5, 0);
  for (const double size : {0.0, below_half, 0.5, 1.5, 2.5, 0x1p52 - 0.5, 0x1p52 + 1, 1e300, kInf})
    for (const double x : {size, -size}) {
      EXPECT_EQ(math::round(x), std::round(x)) << x;
      EXPECT_EQ(std::signbit(math::round(x)), std::signbit(x)) << x;
    }
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    const double x = 1e4 * uniform(8, 0, i) - 5e3, half = std::floor(x) + 0.5;
    ASSERT_EQ(math::round(x), std::round(x)) << x;
    ASSERT_EQ(math::round(half), std::round(half)) << half;
  }
  EXPECT_TRUE(std::isnan(math::round(std::numeric_limits<double>::quiet_NaN())));
}

TEST(Math, LimitsAreThoseOfTheLibrary) {
  struct Pair {
    Own own, library;
  };
  const Pair pairs[] = {
      {math::exp, [](double x) { return std::exp(x); }},
      {math::expm1, [](double x) { return std::expm1(x); }},
      {math::log, [](double x) { return std::log(x); }},
      {math::log1p, [](double x) { return std::log1p(x); }},
      {math::tanh, [](double x) { return std::tanh(x); }},
      {math::atan, [](double x) { return std::atan(x); }},
      {math::sin, [](double x) { return std::sin(x); }},
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& [own, library] : pairs)
    for (const double x : {0.0, -0.0, kInf, -kInf, nan, -1.0, 1e-320, 710.0, -746.0, -740.0}) {
      const double mine = own(x), theirs = library(x);
      if (std::isnan(theirs))
        EXPECT_TRUE(std::isnan(mine)) << x;
      else
        EXPECT_DOUBLE_EQ(mine, theirs) << x;
      EXPECT_TRUE(std::isnan(theirs) || std::signbit(mine) == std::signbit(theirs)) << x;
    }
}

}  // namespace
}  // namespace twinrate

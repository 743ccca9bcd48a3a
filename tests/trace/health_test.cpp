// Rows that repeat the row before: a fault where the rotor turns, chance where all stands still.
#include "trace/health.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "model/random.hpp"

namespace twinrate {
namespace {

// Quiet currents of a coarse ADC and a steady bus; `omega_m` 0: at rest.
RawLog quantised_log(double omega_m) {
  RawLog raw;
  raw.path = "quantised";
  for (std::size_t k = 0; k < 4000; ++k) {
    raw.t.push_back(1e-4 * static_cast<double>(k));
    const auto read = [&](std::uint64_t stream) {
      return 0.005 * std::round(normal(11, stream, k) * 0.008 / 0.005);
    };
    raw.i_a.push_back(read(0));
    raw.i_b.push_back(read(1));
    raw.v_dc.push_back(235.4);
    raw.theta_m.push_back(0.3 + omega_m * raw.t.back());
  }
  return raw;
}

double stale_share(const RawLog& raw) {
  Health health;
  make_record(raw, 3, health);
  return health.stale_share;
}

TEST(Health, AtRestRowsRepeatByChance) {
  EXPECT_EQ(stale_share(quantised_log(0)), 0);
  EXPECT_EQ(stale_share(quantised_log(2)), 0);
}

TEST(Health, ACoarseConverterRepeatsRowsByChanceThoughTheEncoderCounts) {
  RawLog raw = quantised_log(0);
  for (std::size_t k = 0; k < raw.size(); ++k) {
    raw.theta_m[k] += 6e-6 * std::round(0.6 * normal(12, 0, k));
    for (std::vector<double>* i : {&raw.i_a, &raw.i_b}) (*i)[k] = 0.2 * std::round((*i)[k] / 0.2);
  }
  EXPECT_EQ(stale_share(raw), 0);
  // A real fault among them is still one.
  for (std::size_t k = 1000; k < 3000; ++k)
    for (std::vector<double>* column : {&raw.i_a, &raw.i_b, &raw.theta_m})
      (*column)[k] = (*column)[1000];
  EXPECT_GT(stale_share(raw), 0.4);
}

TEST(Health, RowsThatRepeatWhileItTurnsAndLongStretchesAnywhereAreStale) {
  const auto freeze = [](RawLog raw, std::size_t every, std::size_t count) {
    for (std::size_t k = every; k + count < raw.t.size(); k += every)
      for (std::size_t j = 1; j <= count; ++j)
        for (std::vector<double>* column : {&raw.i_a, &raw.i_b, &raw.theta_m})
          (*column)[k + j] = (*column)[k];
    return raw;
  };
  EXPECT_NEAR(stale_share(freeze(quantised_log(2), 100, 1)), 0.01, 0.001);
  EXPECT_NEAR(stale_share(freeze(quantised_log(2), 400, 40)), 0.09, 0.011);
  EXPECT_NEAR(stale_share(freeze(quantised_log(0), 400, 40)), 0.09, 0.011);
}

Vec2 phase_current(const RawLog& raw, std::size_t k) {
  return clarke({raw.i_a[k], raw.i_b[k], -(raw.i_a[k] + raw.i_b[k])});
}

// The currents of a motor that runs up, by a coarse converter; of every `every` rows one is not
// read.
RawLog coarse_currents(std::size_t every) {
  RawLog raw = quantised_log(0);
  for (std::size_t k = 0; k < raw.size(); ++k) {
    raw.theta_m[k] += 200 * raw.t[k] * raw.t[k];
    const auto read = [&](std::uint64_t stream, double angle) {
      const double i = 3 * std::sin(3 * raw.theta_m[k] + angle) + 0.01 * normal(13, stream, k);
      return 0.01 * std::round(i / 0.01);
    };
    const bool held = every > 0 && k % every == every - 1;
    raw.i_a[k] = held ? raw.i_a[k - 1] : read(0, 0);
    raw.i_b[k] = held ? raw.i_b[k - 1] : read(1, -2.0944);
  }
  return raw;
}

TEST(Health, TellsHeldCurrentsFromCoarseOnesThatRepeatByChance) {
  const RawLog good = coarse_currents(0), raw = coarse_currents(50);
  std::size_t repeated = 0;
  for (std::size_t k = 1; k < good.size(); ++k)
    repeated += good.i_a[k] == good.i_a[k - 1] && good.i_b[k] == good.i_b[k - 1];
  EXPECT_GT(repeated, 30);
  Health health;
  make_record(good, 3, health);
  EXPECT_EQ(health.held_share, 0);
  const Record record = make_record(raw, 3, health);
  EXPECT_NEAR(health.held_share, 0.02, 0.004);
  EXPECT_EQ(health.stale_share, 0);
  // What was not read is filled in.
  double held = 0, filled = 0;
  for (std::size_t k = 1; k + 1 < raw.size(); ++k) {
    const Vec2 read = phase_current(good, k);
    held += (phase_current(raw, k) - read).squaredNorm();
    filled += (record.i_alphabeta[k] - read).squaredNorm();
  }
  EXPECT_LT(filled, 0.5 * held) << filled << " " << held;
}

// What a row holds is what was read before the row before it, where both are repeated.
TEST(Health, ARowThatComesLateBehindARepeatedOneIsLeftOut) {
  const RawLog good = quantised_log(40);
  RawLog raw = good;
  for (std::size_t k = 100; k + 10 < raw.size(); k += 100)
    for (std::vector<double> RawLog::*column : {&RawLog::i_a, &RawLog::i_b, &RawLog::theta_m})
      for (std::size_t j = k; j < k + 1 + (k / 100) % 3; ++j)  // one to three rows in turn
        (raw.*column)[j] = (good.*column)[j - 1];
  EXPECT_NEAR(stale_share(raw), 0.02, 0.001);
  Health health;
  const Record record = make_record(raw, 3, health);
  for (std::size_t k = 0; k < record.size(); ++k)
    ASSERT_NEAR(record.theta_m[k], good.theta_m[k], 1e-9) << k;
}

// A load behind a shaft sees in the time that another log has begun.
TEST(Record, TimeShowsWhereALogIsAppended) {
  Health health;
  const Record one = make_record(quantised_log(2), 3, health);
  Record two = one;
  two.append(one);
  ASSERT_EQ(two.size(), 2 * one.size());
  for (std::size_t k = 1; k < two.size(); ++k)
    ASSERT_NEAR(two.t[k] - two.t[k - 1], k == one.size() ? 24e-4 : 1e-4, 1e-9) << k;
  Record later = one;
  for (double& t : later.t) t += 100;
  Record kept = one;
  kept.append(later);
  EXPECT_EQ(kept.t.back(), later.t.back());
}

}  // namespace
}  // namespace twinrate

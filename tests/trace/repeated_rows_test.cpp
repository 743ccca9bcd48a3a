// Repeated rows: a fault if the rotor moves, chance at standstill.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/health.hpp"
#include "trace/tracer.hpp"

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

// Slowly there and back: a count lasts 40 rows, a step of the converter as long, the noise crosses
// neither but now and then.
TEST(Health, ASlowDriveBetweenStepsOfBothConvertersRepeatsNoRow) {
  RawLog raw = quantised_log(0);
  for (std::size_t k = 0; k < raw.size(); ++k) {
    const double way = std::sin(2e-3 * static_cast<double>(k));
    raw.theta_m[k] = 6e-3 * std::floor(12 * way);
    raw.i_a[k] = 0.2 * std::round((1 + way + 0.01 * normal(12, 0, k)) / 0.2);
    raw.i_b[k] = 0.2 * std::round((-1 + 0.3 * way + 0.01 * normal(12, 1, k)) / 0.2);
  }
  EXPECT_EQ(stale_share(raw), 0);
  // A row that is held for a thousand is still found, with the equal ones on either side of it.
  for (std::size_t k = 1500; k < 2500; ++k)
    for (std::vector<double>* column : {&raw.i_a, &raw.i_b, &raw.theta_m})
      (*column)[k] = (*column)[1500];
  EXPECT_GT(stale_share(raw), 0.245);
  EXPECT_LT(stale_share(raw), 0.31);
}

// Every other count lasts two rows, none three.
TEST(Health, ACountThatLastsTwoRowsRepeatsNoRow) {
  RawLog raw = quantised_log(0);
  for (std::size_t k = 0; k < raw.size(); ++k) {
    raw.theta_m[k] = 1e-3 * std::floor(0.7 * static_cast<double>(k));
    for (std::vector<double>* i : {&raw.i_a, &raw.i_b}) (*i)[k] = 0.02 * std::round((*i)[k] / 0.02);
  }
  EXPECT_EQ(stale_share(raw), 0);
}

// Before it starts, all stands.
TEST(Health, ADriveThatIsOffRepeatsNoRow) {
  RawLog raw;
  raw.path = "start";
  for (std::size_t k = 0; k < 4000; ++k) {
    const bool on = k >= 150;
    raw.t.push_back(1e-3 * static_cast<double>(k));
    raw.theta_m.push_back(on ? 0.05 * static_cast<double>(k - 150) : 0);
    raw.i_q.push_back(on ? normal(17, 0, k) : 0);
  }
  EXPECT_EQ(stale_share(raw), 0);
  for (std::size_t k = 200; k < raw.size(); k += 100)
    for (std::vector<double>* column : {&raw.i_q, &raw.theta_m}) (*column)[k] = (*column)[k - 1];
  EXPECT_NEAR(stale_share(raw), 0.0095, 5e-4);
}

TEST(Health, OneRepeatedRowIsChance) {
  const auto share = [](std::size_t repeated) {
    RawLog raw;
    raw.path = "one";
    for (std::size_t k = 0; k < 1200; ++k) {
      raw.t.push_back(5e-3 * static_cast<double>(k));
      raw.theta_m.push_back(0.05 * static_cast<double>(k));
      raw.i_q.push_back(normal(17, 0, k));
    }
    for (std::size_t k = 100; k < 100 * (repeated + 1); k += 100)
      for (std::vector<double>* column : {&raw.i_q, &raw.theta_m}) (*column)[k] = (*column)[k - 1];
    return stale_share(raw);
  };
  EXPECT_EQ(share(1), 0);
  EXPECT_NEAR(share(8), 8 / 1200.0, 1e-9);
}

// A slow log of a rotor that turns back and forth: two rows at equal distances from a turning point
// have the same count, and a current that rises by half a step of its converter often repeats, too.
TEST(Health, AtATurningPointRowsRepeatByThemselves) {
  constexpr double kT = 5e-3, kAccel = 400, kHalf = 0.186, kCount = kTwoPi / 1024;
  RawLog raw;
  raw.path = "turning";
  for (std::size_t k = 0; k < 4000; ++k) {
    const double t = kT * static_cast<double>(k), of_half = std::fmod(t, kHalf),
                 direction = std::fmod(t, 2 * kHalf) < kHalf ? 1 : -1;
    const double way = kAccel * of_half * (of_half - kHalf) / 2;
    raw.t.push_back(t);
    raw.theta_m.push_back(kCount * std::floor(direction * way / kCount));
    raw.i_q.push_back(0.1 * direction * std::floor(std::fmod(0.55 * static_cast<double>(k), 40)));
  }
  EXPECT_EQ(stale_share(raw), 0);
  for (std::size_t k = 100; k < raw.size(); k += 100)
    for (std::vector<double>* column : {&raw.i_q, &raw.theta_m}) (*column)[k] = (*column)[k - 1];
  EXPECT_NEAR(stale_share(raw), 0.008, 1.5e-3);
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

// Currents of an accelerating motor with a coarse ADC; one of `every` rows is not read.
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

TEST(Health, SeparatesHeldCurrentsFromCoarseOnesThatRepeatByChance) {
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
  // Rows that were not read are interpolated.
  double held = 0, filled = 0;
  for (std::size_t k = 1; k + 1 < raw.size(); ++k) {
    const Vec2 read = phase_current(good, k);
    held += (phase_current(raw, k) - read).squaredNorm();
    filled += (record.i_alphabeta[k] - read).squaredNorm();
  }
  EXPECT_LT(filled, 0.5 * held) << filled << " " << held;
}

// Two currents with small changes from row to row. `alike`: common share of their noise.
RawLog slow_currents(double noise_A, double alike, std::size_t every, double peak_A = 2) {
  RawLog raw;
  raw.path = "slow";
  for (std::size_t k = 0; k < 60000; ++k) {
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.theta_m.push_back(2 * raw.t.back());
    const double shared = alike * normal(14, 0, k), own = std::sqrt(1 - alike * alike);
    const auto read = [&](std::uint64_t stream, double angle) {
      const double i = peak_A * std::sin(3 * raw.theta_m[k] + angle) +
                       noise_A * (shared + own * normal(14, stream, k));
      return 0.01 * std::round(i / 0.01);
    };
    const bool held = every > 0 && k % every == every - 1;
    raw.i_a.push_back(held ? raw.i_a[k - 1] : read(1, 0));
    raw.i_b.push_back(held ? raw.i_b[k - 1] : read(2, -2.0944));
    raw.v_dc.push_back(235.4 + 0.2 * normal(14, 3, k));
  }
  return raw;
}

TEST(Health, CurrentsThatHardlyChangeRepeatTogetherWhereTheyAreHeld) {
  const auto held_share = [](const RawLog& raw) {
    Health health;
    make_record(raw, 3, health);
    EXPECT_EQ(health.stale_share, 0);
    return health.held_share;
  };
  EXPECT_EQ(held_share(slow_currents(0.008, 0, 0)), 0);
  EXPECT_NEAR(held_share(slow_currents(0.008, 0, 80)), 1.0 / 80, 0.004);
  EXPECT_EQ(held_share(slow_currents(0.008, 0.7, 0)), 0);  // the noise of both is alike
  EXPECT_NEAR(held_share(slow_currents(0.008, 0.7, 40)), 1.0 / 40, 0.008);
  for (double noise_A : {2e-4, 4e-4, 1e-3})  // within the scale's steps
    EXPECT_EQ(held_share(slow_currents(noise_A, 0, 0, 0.8)), 0) << noise_A;
  RawLog at_rest = slow_currents(0.008, 0, 40);  // where the whole row is repeated
  at_rest.theta_m.assign(at_rest.size(), 0.3);
  for (std::size_t k = 39; k < at_rest.size(); k += 40) at_rest.v_dc[k] = at_rest.v_dc[k - 1];
  EXPECT_EQ(held_share(at_rest), 0);
}

// Three sensors on currents that a noisy drive moves from row to row: two currents that repeat make
// the third repeat, because they add up to zero. One of `every` rows is not read.
RawLog currents_that_add_up(std::uint64_t seed, std::size_t rows, std::size_t every) {
  RawLog raw;
  raw.path = "three sensors";
  for (std::size_t k = 0; k < rows; ++k) {
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.theta_m.push_back(2 * raw.t.back());
    const std::array<double, 2> moved = {0.04 * normal(seed, 0, k), 0.04 * normal(seed, 1, k)};
    const auto read = [&](std::uint64_t stream, double angle) {
      const double i = moved[0] * std::cos(angle) + moved[1] * std::sin(angle);
      return 0.01 * std::round((i + 0.006 * normal(seed, stream, k)) / 0.01);
    };
    const bool held = every > 0 && k % every == every - 1;
    raw.i_a.push_back(held ? raw.i_a[k - 1] : read(2, 0));
    raw.i_b.push_back(held ? raw.i_b[k - 1] : read(3, kTwoPi / 3));
    raw.i_c.push_back(held ? raw.i_c[k - 1] : read(4, -kTwoPi / 3));
    raw.v_dc.push_back(235.4 + 0.2 * normal(seed, 5, k));
  }
  return raw;
}

TEST(Health, ThreeCurrentsThatAddUpToZeroRepeatTogetherByChance) {
  const auto held_share = [](const RawLog& raw) {
    Health health;
    make_record(raw, 3, health);
    return health.held_share;
  };
  int claims = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed)
    claims += held_share(currents_that_add_up(seed, 1500, 0)) > 0;
  EXPECT_EQ(claims, 0);
  EXPECT_NEAR(held_share(currents_that_add_up(0, 20000, 50)), 0.02, 0.004);
}

// Three currents of `peak` (t) at the electrical angle 3 theta_m, read with steps of lsb_A.
template <class Peak>
RawLog coarse_phases(double T_s, double turn_rad, double noise_A, double lsb_A, Peak peak) {
  RawLog raw;
  raw.path = "coarse";
  for (std::size_t k = 0; k < 30000; ++k) {
    raw.t.push_back(T_s * static_cast<double>(k));
    raw.theta_m.push_back(turn_rad * static_cast<double>(k));
    const double i = peak(k, raw.theta_m[k]);
    const auto read = [&](std::uint64_t stream, double angle) {
      const double noise = noise_A * normal(15, stream, k);
      return lsb_A * std::round((i * std::cos(3 * raw.theta_m[k] + angle) + noise) / lsb_A);
    };
    raw.i_a.push_back(read(1, 0));
    raw.i_b.push_back(read(2, -2.0944));
    raw.i_c.push_back(read(3, 2.0944));
    raw.v_dc.push_back(235.4 + 0.2 * normal(15, 4, k));
  }
  return raw;
}
double held_share(const RawLog& raw) {
  Health health;
  make_record(raw, 3, health);
  return health.held_share;
}

// Where the currents change by less than a step a row, their slope is that of the steps: one that
// leaps and decays seems to be held in half of the rows.
TEST(Health, CurrentsOfFewStepsThatLeapAreNotHeld) {
  for (double leap_A : {0.05, 0.1, 0.2}) {
    double i = 0;
    const RawLog raw = coarse_phases(1e-4, 0.0011, 0.002, 0.05, [&](std::size_t k, double) {
      i = 0.85 * i + (k % 11 == 0 ? leap_A : 0);
      return i + 0.3;
    });
    EXPECT_EQ(held_share(raw), 0) << leap_A;
  }
}

// A load once a turn: for half of it, all currents are below half a step.
TEST(Health, CurrentsThatFadeBelowAStepAreNotHeld) {
  for (double peak_A : {0.2, 0.8}) {
    const auto peak = [&](std::size_t, double theta_m) {
      return peak_A * (1 + std::cos(theta_m)) / 2;
    };
    EXPECT_EQ(held_share(coarse_phases(5e-3, 0.6, 0.02, 0.15, peak)), 0) << peak_A;
  }
}

// A controller that sees the counts of a coarse encoder makes the currents leap at each and decay.
// `sensors` of the three phases.
RawLog leaping_currents(int sensors) {
  RawLog raw;
  raw.path = "leaping";
  double leap = 0;
  for (std::size_t k = 0; k < 60000; ++k) {
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.theta_m.push_back(kTwoPi / 512 * std::floor(0.09 * static_cast<double>(k)));
    leap *= 0.85;
    if (k > 0 && raw.theta_m[k] != raw.theta_m[k - 1]) leap = 0.05;
    const auto read = [&](std::uint64_t stream, double share) {
      return 0.01 * std::round((share * leap + 0.006 * normal(15, stream, k)) / 0.01);
    };
    raw.i_a.push_back(read(1, 1));
    raw.i_b.push_back(read(2, -0.7));
    raw.i_c.push_back(sensors == 3 ? read(3, -0.3) : -(raw.i_a[k] + raw.i_b[k]));
    raw.v_dc.push_back(235.4 + 0.2 * normal(15, 4, k));
  }
  return raw;
}

TEST(Health, CurrentsThatLeapAtEachCountOfAnEncoderAreNotHeld) {
  for (int sensors : {2, 3}) {
    Health health;
    make_record(leaping_currents(sensors), 3, health);
    EXPECT_EQ(health.held_share, 0) << sensors;
  }
}

// Two sensors of currents that step once in `rows`. The angle changes in the first two of them: if
// these are not all rows, half of those repeat by chance, and none repeats the row before the last.
RawLog stepping_currents(std::size_t rows) {
  constexpr double kStep = 0.06, kNoise = 0.008, kLsb = 0.02;  // A
  RawLog raw;
  raw.path = "steps";
  int count = 0;
  for (std::size_t k = 0; k < 60000; ++k) {
    const std::size_t steps = k / rows;
    if (k % rows < 2) ++count;
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.theta_m.push_back(kTwoPi / 8192 * count);
    const auto read = [&](std::uint64_t phase, double size) {
      const double i = 0.5 + (steps % 2 ? kStep * size : 0) + kNoise * normal(17, phase, k);
      return kLsb * std::round(i / kLsb);
    };
    raw.i_a.push_back(read(0, 1)), raw.i_b.push_back(read(1, steps % 4 == 1 ? 1 : -1));
    raw.v_dc.push_back(235.4 + 0.2 * normal(17, 3, k));
  }
  return raw;
}

TEST(Health, CurrentsThatStepAreNotHeld) {
  for (std::size_t rows : {2, 3}) EXPECT_EQ(held_share(stepping_currents(rows)), 0) << rows;
}

// After two repeated rows, a row holds a reading older than that of the row before.
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

// The time shows the start of another log to a load behind a shaft.
TEST(Record, TimeShowsWhereALogIsAppended) {
  Health health;
  const Record one = make_record(quantised_log(2), 3, health);
  Record two = one;
  two.append(one);
  ASSERT_EQ(two.size(), 2 * one.size());
  for (std::size_t k = 1; k < two.size(); ++k)
    ASSERT_NEAR(two.t[k] - two.t[k - 1], k == one.size() ? 24e-4 : 1e-4, 1e-9) << k;
  // A speed or a change of current across the seam would mix both logs.
  for (std::size_t k = one.size() - 6; k < one.size() + 6; ++k) {
    EXPECT_FALSE(two.motion_ok[k]) << k;
    EXPECT_FALSE(two.electrical_ok[k]) << k;
  }
  EXPECT_TRUE(two.motion_ok[one.size() + 40]);
  Record later = one;
  for (double& t : later.t) t += 100;
  Record kept = one;
  kept.append(later);
  EXPECT_EQ(kept.t.back(), later.t.back());
}

}  // namespace
}  // namespace twinrate

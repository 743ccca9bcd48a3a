// Faults of one signal, and of the clock.
#include "trace/health.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/decimals.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

// A drive that turns, 2 s of it.
const RawLog& turning_log() {
  static const RawLog log = simulate_synthetic({.duration_s = 2});
  return log;
}

std::size_t faults_of(const std::vector<SignalFault>& faults, const char* signal) {
  return static_cast<std::size_t>(
      std::count_if(faults.begin(), faults.end(), [&](const SignalFault& fault) {
        return raw_columns()[fault.column].name == std::string(signal);
      }));
}

// A vector that turns by 0.2 rad a row: its chord would be 2 % short.
TEST(Health, AMissingRowIsBridgedWhereTheRotorIs) {
  constexpr double kTurn = 0.2;  // rad, electrical
  RawLog raw;
  raw.path = "turning";
  for (std::size_t k = 0; k < 2000; ++k) {
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.theta_m.push_back(kTurn / 3 * static_cast<double>(k));
    const Vec3 i = inverse_clarke(
        inverse_park({0.5, 2.0 + 1e-4 * static_cast<double>(k % 7)}, 3 * raw.theta_m.back()));
    raw.i_a.push_back(i[0]);
    raw.i_b.push_back(i[1]);
    const Vec2 u =
        inverse_park({-20, 90 + (k == 501 ? 30.0 : 0.0)}, 3 * raw.theta_m.back() + kTurn / 2);
    raw.u_alpha.push_back(u[0]);
    raw.u_beta.push_back(u[1]);
  }
  Health health;
  const Record whole = make_record(raw, 3, health);
  raw.t.erase(raw.t.begin() + 500);
  for (const RawColumn& c : raw_columns())
    if (auto& x = raw.*c.values; !x.empty()) x.erase(x.begin() + 500);
  const Record record = make_record(raw, 3, health);
  ASSERT_EQ(record.size(), whole.size());
  EXPECT_TRUE(record.electrical_ok[500]);
  EXPECT_LT((record.i_alphabeta[500] - whole.i_alphabeta[500]).norm(), 1e-3);
  // From the row before only: the row after it is 30 V off.
  EXPECT_LT((record.u_alphabeta[500] - whole.u_alphabeta[500]).norm(), 1e-6);
}

TEST(Health, AGapTooLongForAStraightLineIsNotUsed) {
  RawLog raw = turning_log();
  const auto cut = [](std::vector<double>& x) {
    if (!x.empty()) x.erase(x.begin() + 8000, x.begin() + 8040);
  };
  cut(raw.t);
  for (const RawColumn& c : raw_columns()) cut(raw.*c.values);
  Health health;
  const Record record = make_record(raw, 3, health);
  ASSERT_EQ(record.size(), turning_log().size());
  for (std::size_t k = 8000; k < 8040; ++k) {
    ASSERT_FALSE(record.electrical_ok[k]) << k;
    ASSERT_FALSE(record.motion_ok[k]) << k;
  }
  EXPECT_TRUE(record.electrical_ok[7990] && record.electrical_ok[8050]);
}

// Cut off in any of the phases that are measured, a row says nothing of the voltage.
TEST(Health, ARowThatIsClippedInOnePhaseIsNotUsed) {
  for (std::vector<double> RawLog::*phase : {&RawLog::i_a, &RawLog::i_b}) {
    RawLog raw = turning_log();
    std::vector<char> clipped(raw.size(), 0);
    for (std::size_t k = 0; k < raw.size(); ++k) {
      double& i = (raw.*phase)[k];
      clipped[k] = std::abs(i) > 0.9;
      i = std::clamp(i, -0.9, 0.9);
    }
    raw.i_c.clear();
    Health health;
    const Record record = make_record(raw, 3, health);
    ASSERT_NEAR(health.i_limit, 0.9, 1e-9);
    ASSERT_EQ(record.size(), clipped.size());
    std::size_t used = 0;
    for (std::size_t k = 0; k < record.size(); ++k) used += clipped[k] && record.electrical_ok[k];
    EXPECT_GT(std::count(clipped.begin(), clipped.end(), 1), 1000);
    EXPECT_EQ(used, 0u);
  }
}

TEST(Health, GlitchesAreCountedAndBridged) {
  RawLog raw = turning_log();
  raw.i_a[3] = -1e300;
  for (std::size_t k = 500; k < raw.size(); k += 1000) raw.i_a[k] += 4;
  raw.i_a[5000] = 1e12;
  for (std::size_t k = 700; k < raw.size(); k += 2000)
    raw.theta_m[k] += 0.1, raw.theta_m[k + 1] += 0.1;
  for (std::size_t k = 900; k < raw.size(); k += 4000) raw.u_beta[k] -= 80;
  Health clean, health;
  const Record good = make_record(turning_log(), 3, clean);
  EXPECT_TRUE(clean.glitches.empty());
  const Record record = make_record(raw, 3, health);
  EXPECT_EQ(faults_of(health.glitches, "i_a"), 22);
  EXPECT_EQ(faults_of(health.glitches, "theta_m"), 10);
  EXPECT_EQ(faults_of(health.glitches, "u_beta"), 5);
  EXPECT_EQ(health.glitches.size(), 37);
  EXPECT_EQ(health.i_limit, 0);
  EXPECT_NEAR(health.i_sum_max, clean.i_sum_max, 1e-9);
  ASSERT_EQ(record.size(), good.size());
  for (std::size_t k = 0; k < record.size(); ++k) {
    ASSERT_NEAR(record.theta_m[k], good.theta_m[k], 1e-4) << k;
    ASSERT_LT((record.i_alphabeta[k] - good.i_alphabeta[k]).norm(), 0.1) << k;
    ASSERT_LT((record.u_alphabeta[k] - good.u_alphabeta[k]).norm(), 20) << k;
  }
  ASSERT_FALSE(health.lines().empty());
  EXPECT_NE(health.lines()[0].find("22 in i_a (the first at 0.0003 s)"), std::string::npos)
      << health.lines()[0];
}

// A winding with steps of voltage and pulses of one row, to which the current responds; a bus
// voltage with steps; a quantised angle.
TEST(Health, AnAppliedPulseIsNoGlitch) {
  RawLog raw;
  raw.path = "pulses";
  double i = 0;
  for (std::size_t k = 0; k < 8000; ++k) {
    const double step = k % 1500 > 700 ? 6 : 0, pulse = k % 400 == 50 ? 50 : 0;
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.i_alpha.push_back(0.01 * std::round((i + 0.008 * normal(21, 0, k)) / 0.01));
    raw.i_beta.push_back(0.01 * std::round(0.8 * normal(21, 1, k)));
    raw.u_alpha.push_back(step + pulse);
    raw.u_beta.push_back(0);
    raw.v_dc.push_back(k > 3000 ? 230 : 240);
    raw.theta_m.push_back(k % 97 == 0 ? 6e-6 : 0);
    i += 1e-4 * (step + pulse - 1.05 * i) / 12.7e-3;
  }
  Health health;
  make_record(raw, 3, health);
  EXPECT_TRUE(health.glitches.empty()) << health.lines()[0];
  EXPECT_TRUE(health.frozen.empty());
  raw.u_alpha[3333] += 50;  // this one was not applied
  make_record(raw, 3, health);
  EXPECT_EQ(faults_of(health.glitches, "u_alpha"), 1);
}

// Two readings that differ by rounding are no step of the ADC.
TEST(Health, ACurrentThatIsNearlyAlwaysZeroIsCoarseAndHasNoGlitches) {
  RawLog raw;
  raw.path = "coarse";
  for (std::size_t k = 0; k < 8000; ++k) {
    const double sign = k % 800 < 400 ? 1 : -1;
    const double read = k % 400 == 50 ? 0.2 : k % 400 == 51 ? std::nextafter(0.2, 1.0) : 0;
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.i_a.push_back(sign * read);
    raw.i_b.push_back(0.01 * std::round(0.8 * normal(23, 0, k)));
    raw.theta_m.push_back(1e-3 * static_cast<double>(k));
  }
  Health health;
  make_record(raw, 3, health);
  EXPECT_TRUE(health.glitches.empty());
  EXPECT_NEAR(health.i_lsb, 0.2, 1e-9);
}

// A controller responds to each step of a coarse ADC with one row of voltage.
TEST(Health, VoltageThatAnswersAReadingIsNoGlitch) {
  RawLog raw;
  raw.path = "coarse";
  for (std::size_t k = 0; k < 8000; ++k) {
    const bool read = k % 400 == 50;
    raw.t.push_back(1e-4 * static_cast<double>(k));
    raw.i_alpha.push_back(read ? 0.2 : 0);
    raw.i_beta.push_back(0);
    raw.u_alpha.push_back((read ? -8 : 0) + 0.01 * normal(22, 0, k));
    raw.u_beta.push_back(0.01 * normal(22, 1, k));
    raw.theta_m.push_back(1e-3 * static_cast<double>(k));
  }
  Health health;
  make_record(raw, 3, health);
  EXPECT_TRUE(health.glitches.empty());
  raw.u_alpha[3333] -= 8;
  make_record(raw, 3, health);
  EXPECT_EQ(faults_of(health.glitches, "u_alpha"), 1);
}

TEST(Health, ASignalThatFreezesIsLeftOutWhileItStands) {
  RawLog raw = turning_log();
  EXPECT_TRUE([&] {
    Health clean;
    make_record(raw, 3, clean);
    return clean.frozen.empty();
  }());
  for (std::size_t k = 4001; k < 6000; ++k) raw.theta_m[k] = raw.theta_m[4000];
  for (std::size_t k = 9001; k < 9100; ++k) raw.i_b[k] = raw.i_b[9000];
  Health health;
  const Record record = make_record(raw, 3, health);
  ASSERT_EQ(health.frozen.size(), 2);
  EXPECT_EQ(faults_of(health.frozen, "theta_m"), 1);
  EXPECT_NEAR(health.frozen[0].t_end - health.frozen[0].t_begin, 0.2, 1e-3);
  for (std::size_t k = 0; k < record.size(); ++k) {
    const bool stands = (k >= 4000 && k < 6000) || (k >= 9000 && k < 9100);
    ASSERT_EQ(record.motion_ok[k], !stands) << k;
    ASSERT_EQ(record.electrical_ok[k], !stands) << k;
  }
}

// A sine of 2 A with steps of 0.08 A; the topmost step has at most 2.4 times the samples of others.
TEST(Health, ACoarseScaleHasALimitWhereItIsCutAlone) {
  const auto limit = [](double amplitude, double cut) {
    RawLog raw = turning_log();
    for (std::size_t k = 0; k < raw.size(); ++k) {
      const Vec3 i =
          inverse_clarke(amplitude * Vec2(std::cos(40 * raw.t[k]), std::sin(40 * raw.t[k])));
      const auto read = [&](double x) {
        return 0.08 * std::round(std::clamp(x, -cut, cut) / 0.08);
      };
      raw.i_a[k] = read(i[0]);
      raw.i_b[k] = read(i[1]);
    }
    Health health;
    make_record(raw, 3, health);
    return health.i_limit;
  };
  for (double amplitude = 1.96; amplitude < 2.04; amplitude += 0.01)
    EXPECT_EQ(limit(amplitude, 10), 0) << amplitude;
  EXPECT_NEAR(limit(2, 1.9), 1.92, 1e-9);
  EXPECT_NEAR(limit(2, 1.7), 1.68, 1e-9);
}

TEST(Health, AFewPausesAreNoMissingRowsAndManyAre) {
  const auto health_with = [](std::size_t gaps) {
    RawLog raw = turning_log();
    for (std::size_t gap = gaps; gap > 0; --gap) {
      const auto cut = [&](std::vector<double>& x) {
        const auto first = x.begin() + static_cast<std::ptrdiff_t>(2000 * gap);
        if (!x.empty()) x.erase(first, first + 100);
      };
      cut(raw.t);
      for (const RawColumn& c : raw_columns()) cut(raw.*c.values);
    }
    Health health;
    make_record(raw, 3, health);
    return health;
  };
  const Health two = health_with(2), many = health_with(8);
  EXPECT_EQ(two.missing_share, 0);
  ASSERT_EQ(two.pauses.size(), 2);
  EXPECT_NEAR(two.pauses[1].t_end - two.pauses[1].t_begin, 101e-4, 1e-9);
  EXPECT_NEAR(many.missing_share, 800.0 / 20000, 1e-3);
  EXPECT_TRUE(many.pauses.empty());
}

// A vector that turns by 0.9 rad a row passes a limit within a row or two.
TEST(Health, ALimitThatFewRowsInSuccessionHoldIsCommonToTwoSensors) {
  const auto limit = [](double cut_a, double cut_b) {
    RawLog raw = turning_log();
    for (std::size_t k = 0; k < raw.size(); ++k) {
      const double turn = 0.9 * static_cast<double>(k);
      const Vec3 i = inverse_clarke(2 * Vec2(std::cos(turn), std::sin(turn)));
      raw.i_a[k] = std::clamp(i[0], -cut_a, cut_a);
      raw.i_b[k] = std::clamp(i[1], -cut_b, cut_b);
    }
    Health health;
    make_record(raw, 3, health);
    return health.i_limit;
  };
  EXPECT_EQ(limit(1.9, 1.9), 1.9);
  EXPECT_EQ(limit(3, 3), 0);
  EXPECT_EQ(limit(1.9, 1.8), 0);
}

TEST(Health, ConstantCurrentsGiveNoScale) {
  RawLog raw = turning_log();
  const auto verdict = [&] {
    Health health;
    const Record record = make_record(raw, 3, health);
    EXPECT_EQ(health.i_limit, 0);
    return trace_record(record, servo(), health, {}).sentence;
  };
  raw.i_b.assign(raw.size(), -0.25);
  EXPECT_EQ(verdict().find("Cannot tell: i_b has the same value in every row"), 0u) << verdict();
  for (auto* i : {&raw.i_a, &raw.i_b, &raw.i_c}) i->assign(raw.size(), 0);
  EXPECT_EQ(verdict().find("Cannot tell: no current flows"), 0u) << verdict();
  for (auto* x : {&raw.u_alpha, &raw.u_beta, &raw.v_dc, &raw.theta_m, &raw.T_load})
    x->assign(raw.size(), 0);
  EXPECT_EQ(verdict().find("Cannot tell: no current flows"), 0u) << verdict();
}

TEST(Health, JitteredTimeStampsLeaveTheRowsUniform) {
  RawLog raw = turning_log();
  for (std::size_t k = 0; k < raw.size(); ++k) raw.t[k] += 3e-5 * (2 * uniform(31, 0, k) - 1);
  Health clean, health;
  const Record good = make_record(turning_log(), 3, clean);
  EXPECT_FALSE(clean.stray || clean.uneven);
  const Record record = make_record(raw, 3, health);
  EXPECT_TRUE(health.stray);
  EXPECT_FALSE(health.uneven);
  EXPECT_NEAR(health.jitter, 0.3 / std::sqrt(3.0), 0.03);
  EXPECT_NEAR(health.T_s, 1e-4, 1e-9);
  EXPECT_EQ(health.missing_share, 0);
  ASSERT_EQ(record.size(), good.size());
  for (std::size_t k = 1; k < record.size(); ++k) {
    ASSERT_EQ(record.theta_m[k], good.theta_m[k]) << k;
    ASSERT_NEAR(record.t[k] - record.t[k - 1], health.T_s, 1e-12) << k;
  }
}

// Signals in closed form at intervals of one to three times 50 us.
TEST(Health, UnevenRowsAreResampledUniformly) {
  const auto theta_m = [](double t) { return 30 * t + 0.2 * std::sin(9 * t); };
  const auto current = [&](double t) { return 4 * std::cos(3 * theta_m(t)); };
  const auto flux = [&](double t) { return 0.5 * std::sin(100 * t); };  // integral of the voltage
  RawLog raw;
  raw.path = "uneven";
  double t = 0;
  for (std::size_t k = 0; k < 20000; ++k) {
    const double step = 5e-5 * (1 + std::floor(3 * uniform(41, 0, k)));
    raw.t.push_back(t);
    raw.theta_m.push_back(theta_m(t));
    raw.i_alpha.push_back(current(t));
    raw.i_beta.push_back(1 - current(t));
    raw.u_alpha.push_back((flux(t + step) - flux(t)) / step);
    raw.u_beta.push_back(0);
    t += k == 9000 ? 0.05 : step;  // a gap
  }
  Health health;
  const Record record = make_record(raw, 3, health);
  EXPECT_TRUE(health.uneven);
  EXPECT_NEAR(health.T_s, 1e-4, 2e-6);
  EXPECT_EQ(health.missing_share, 0);
  ASSERT_EQ(health.pauses.size(), 1);
  EXPECT_NEAR(health.pauses[0].t_end - health.pauses[0].t_begin, 0.05, 1e-4);
  for (std::size_t k = 0; k < record.size(); ++k) {
    ASSERT_NEAR(record.t[k] - record.t[k == 0 ? 0 : k - 1], k == 0 ? 0 : health.T_s, 1e-10) << k;
    if (!record.electrical_ok[k]) continue;
    const double at = record.t[k];
    ASSERT_NEAR(record.theta_m[k], theta_m(at), 1e-6) << k;
    ASSERT_NEAR(record.i_alphabeta[k][0], current(at), 1e-5) << k;
    ASSERT_NEAR(record.u_alphabeta[k][0], (flux(at + health.T_s) - flux(at)) / health.T_s, 0.3)
        << k;
  }
  // Over many rows nothing of the voltage is lost.
  double sum = 0;
  for (std::size_t k = 1000; k < 5000; ++k) sum += record.u_alphabeta[k][0] * health.T_s;
  EXPECT_NEAR(sum, flux(record.t[5000]) - flux(record.t[1000]), 1e-4);
}

// A voltage that stands in rotor axes is resampled without a lag, also over intervals twice as long.
TEST(Health, UnevenRowsOfATurningVoltageHaveNoLag) {
  constexpr int n_p = 3;
  constexpr double omega_m = 30, T_s = 1e-3;
  RawLog raw;
  raw.path = "uneven";
  double t = 0;
  for (std::size_t k = 0; k < 5000; ++k) {
    const double step = T_s * (0.9 + 0.2 * uniform(43, 0, k)) * (k % 20 == 7 ? 2 : 1);
    const double turned = n_p * omega_m * step;
    const Vec2 u =
        inverse_park({0, 20 * std::sin(turned / 2) / (turned / 2)}, n_p * omega_m * (t + step / 2));
    raw.t.push_back(t);
    raw.theta_m.push_back(omega_m * t);
    raw.i_alpha.push_back(0);
    raw.i_beta.push_back(0);
    raw.u_alpha.push_back(u[0]);
    raw.u_beta.push_back(u[1]);
    t += step;
  }
  Health health;
  const Record record = make_record(raw, n_p, health);
  ASSERT_TRUE(health.uneven);
  for (std::size_t k = 0; k + 1 < record.size(); ++k) {
    if (!record.electrical_ok[k]) continue;
    const Vec2 u = park(record.u_alphabeta[k], n_p * omega_m * (record.t[k] + health.T_s / 2));
    ASSERT_NEAR(u[0], 0, 1e-3) << k;
  }
}

// 9 kHz with four decimals of a second: every ninth interval is twice as long. The angle follows the
// rows. Rows that are missing at random leave an even clock behind, and regular ones jump in angle.
TEST(Health, StampsOfFewDigitsAreNoMissingRows) {
  const auto health_of = [](auto&& skips) {
    RawLog raw = turning_log(), few;
    few.path = "few";
    for (std::size_t k = 0; k < raw.size(); ++k) {
      if (skips(k)) continue;
      few.t.push_back(1e-4 * std::round(static_cast<double>(k) / 0.9));
      for (const RawColumn& c : raw_columns())
        if (!(raw.*c.values).empty()) (few.*c.values).push_back((raw.*c.values)[k]);
    }
    Health health;
    make_record(few, 3, health);
    return health;
  };
  const Health whole = health_of([](std::size_t) { return false; });
  EXPECT_EQ(whole.missing_share, 0);
  EXPECT_TRUE(whole.stray && !whole.uneven);
  EXPECT_NEAR(whole.T_s, 1 / 9e3, 1e-8);
  const Health lost = health_of([](std::size_t k) { return uniform(3, 0, k) < 0.05; });
  EXPECT_GT(lost.missing_share, 0.04);
}

// One value of the next decade ends in zeros, and a limit repeats.
TEST(Health, TheDigitsOfASignalAreThoseOfManyValues) {
  Decimals decimals;
  for (int k = 0; k < 1000; ++k) decimals.add(1e-3 * std::round(9900 * std::sin(0.7 * k)));
  for (int k = 0; k < 1000; ++k) decimals.add(100);
  EXPECT_NEAR(decimals.digit(), 1e-3, 1e-12);
}

// A file of few decimals. Two sensors: the third current is computed, and rounded like the others.
TEST(Health, ARoundedSumOfTheCurrentsIsNoThirdSensor) {
  const auto three_sensors = [](double digit, double amplitude_A, double noise_A) {
    RawLog raw = turning_log();
    const auto rounded = [digit](double x) { return digit * std::round(x / digit); };
    for (std::size_t k = 0; k < raw.size(); ++k) {
      const double a = amplitude_A * std::sin(0.11 * static_cast<double>(k)),
                   b = amplitude_A * std::sin(0.11 * static_cast<double>(k) - 2.1);
      raw.i_a[k] = rounded(a), raw.i_b[k] = rounded(b);
      raw.i_c[k] = rounded(-a - b + noise_A * normal(5, 0, k));
    }
    Health health;
    make_record(raw, 3, health);
    return health.i_c_measured();
  };
  EXPECT_FALSE(three_sensors(1e-3, 12, 0));
  EXPECT_TRUE(three_sensors(1e-3, 12, 5e-3));
  EXPECT_FALSE(three_sensors(1e-4, 600, 0));
  EXPECT_TRUE(three_sensors(1e-4, 600, 5e-3));
  EXPECT_FALSE(three_sensors(1e-5, 12, 0));
  EXPECT_TRUE(three_sensors(1e-5, 12, 1e-3));
}

}  // namespace
}  // namespace twinrate

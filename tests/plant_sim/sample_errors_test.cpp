// Late signals, coarse currents, lost and repeated rows, as MEASUREMENT shows them.
#include "plant_sim/sample_errors.hpp"

#include <gtest/gtest.h>

#include "plant_sim/plant.hpp"
#include "tests/support/allocation_count.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/effects.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::sample_errors_test {
namespace {

constexpr double kTs = 2e-4, kR = 1.2, kL = 5e-4;

Plant plant_with(const std::string& effect, const std::string& more = "") {
  // Locked rotor, exact sensors, commands act at once: phase a is an RL circuit.
  return test::plant_of(
      Config::parse("preset = \"dilys2021\"\n[machine]\nJ_kgm2 = 1e4\n[plant]\n"
                    "delay_samples = 0\n[sensors]\n"
                    "i_noise_rms_A = 0.0\ni_lsb_A = 0.0\n" +
                        more + "[[effect]]\n" + effect,
                    "d"));
}
std::string lag(const char* signal, const char* form, double lag_s) {
  return fmt::format("kind = \"signal_lag\"\nsignal = \"{}\"\nform = \"{}\"\nlag_s = {}\n", signal,
                     form, lag_s);
}

double voltage(std::int64_t k) {
  return k < 0 ? 0 : 3 * std::sin(0.3 * static_cast<double>(k)) + 2;
}
void tick(Plant& plant) {
  plant.take_command({.k = plant.k(), .u_alphabeta_ref = {voltage(plant.k()), 0}});
  ASSERT_TRUE(plant.advance());
}
void coast(Plant& plant) {
  plant.take_command({.k = plant.k()});
  ASSERT_TRUE(plant.advance());
}
// The RL circuit after `T` with voltage u.
double circuit(double i, double u, double T) {
  return u / kR + (i - u / kR) * std::exp(-kR / kL * T);
}

TEST(SignalLag, OfTheCurrentSensorShowsTheCurrentOfThenBetweenTicksToo) {
  for (double delay : {5e-5, 2e-4, 3.3e-4, 1.1e-3}) {
    Plant plant = plant_with(lag("current", "delay", delay));
    const auto whole = static_cast<std::int64_t>(delay / kTs + 1e-9);
    const double part = delay - static_cast<double>(whole) * kTs;
    std::vector<double> i{0};
    for (std::int64_t k = 0; k < 60; ++k) {
      tick(plant);
      i.push_back(circuit(i.back(), voltage(k), kTs));
      EXPECT_NEAR(plant.truth().i_dq[0], i.back(), 1e-6);
      // Of tick k+1, from interval k - whole.
      const std::int64_t from = k - whole;
      const double then =
          from < 0 ? 0 : circuit(i[static_cast<std::size_t>(from)], voltage(from), kTs - part);
      ASSERT_NEAR(clarke(plant.sample().i_abc)[0], then, 2e-6) << delay << " " << k;
    }
  }
}

TEST(SignalLag, OfTheCurrentsFilterLagsTheTruthByItsTimeConstant) {
  Plant plant = plant_with(lag("current", "first_order", 1e-3));
  double filtered = 0, before = 0;
  for (std::int64_t k = 0; k < 60; ++k) {
    tick(plant);
    const double now = plant.truth().i_dq[0];
    // Oracle: small steps through the current that is linear between ticks.
    constexpr int kFine = 1000;
    for (int j = 0; j < kFine; ++j) {
      const double x = before + (now - before) * (j + 0.5) / kFine;
      filtered += (x - filtered) * (1 - std::exp(-kTs / kFine / 1e-3));
    }
    before = now;
    EXPECT_NEAR(clarke(plant.sample().i_abc)[0], filtered, 1e-5);
  }
}

TEST(SignalLag, OfTheVoltageActsLaterThanTheDriveBelieves) {
  for (double delay : {6e-5, 3e-4}) {
    Plant plant = plant_with(lag("voltage", "delay", delay));
    const auto whole = static_cast<std::int64_t>(delay / kTs);
    const double part = delay / kTs - static_cast<double>(whole);
    double i = 0;
    for (std::int64_t k = 0; k < 60; ++k) {
      tick(plant);
      EXPECT_NEAR(plant.sample().u_alphabeta[0], voltage(k), 1e-9);
      // Before the first command the duties are 1/2, zero voltage; the delay line starts with the
      // first command.
      const auto asked = [](std::int64_t j) { return voltage(std::max<std::int64_t>(j, 0)); };
      i = circuit(i, (1 - part) * asked(k - whole) + part * asked(k - whole - 1), kTs);
      ASSERT_NEAR(plant.truth().i_dq[0], i, 2e-6) << delay << " " << k;
    }
  }
}

Plant turning(const std::string& effect) {
  return test::plant_of(
      Config::parse("preset = \"dilys2021\"\nstart = \"flying\"\n[machine]\n"
                    "psi_f_Wb = 1e-6\nB_Nms = 1e-5\nJ_kgm2 = 1e-5\n[sensors]\n"
                    "i_noise_rms_A = 0.0\ni_lsb_A = 0.0\n[[effect]]\n" +
                        effect,
                    "d"));
}

TEST(SignalLag, OfTheAngleIsTheAngleOfThenAndTheSpeedFollows) {
  for (double delay : {3e-5, 4.5e-4}) {
    Plant plant = turning(lag("angle", "delay", delay));
    for (int k = 0; k < 200; ++k) {
      coast(plant);
      if (k < 10) continue;
      // 100 rad/s, slowed by B with 1 s.
      const double t = (k + 1) * kTs - delay;
      EXPECT_NEAR(plant.sample().theta_m, 100 * (1 - std::exp(-t)), 1e-6);
      EXPECT_NEAR(plant.sample().omega_m, 100 * std::exp(-(t - 0.5 * kTs)), 1e-3);
    }
  }
}

TEST(SignalLag, OfTheSpeedLeavesTheAngleAlone) {
  for (const char* form : {"delay", "first_order"}) {
    Plant plant = turning(lag("speed", form, 5e-3));
    for (int k = 0; k < 400; ++k) coast(plant);
    const double t = 400 * kTs;
    EXPECT_NEAR(plant.sample().theta_m, 100 * (1 - std::exp(-t)), 1e-6);
    EXPECT_NEAR(plant.sample().omega_m, 100 * std::exp(-(t - 5e-3)), 5e-3);
    EXPECT_NEAR(plant.truth().omega_m, 100 * std::exp(-t), 1e-4);  // a magnet of 1 uWb
  }
}

TEST(AdcEffects, CurrentsComeInStepsAndStopAtTheLimit) {
  Plant plant = plant_with(
      "kind = \"adc_quantisation\"\nlsb_A = 0.25\n[[effect]]\nkind = \"adc_clipping\"\n"
      "limit_A = 2.5\n");
  double largest_error = 0;
  int clipped = 0;
  for (int k = 0; k < 100; ++k) {
    tick(plant);
    const Vec3 i_abc = plant.sample().i_abc;
    const double i_a = plant.truth().i_dq[0];
    EXPECT_NEAR(std::remainder(i_abc[0], 0.25), 0, 1e-12);
    EXPECT_LE(std::abs(i_abc[0]), 2.5);
    clipped += i_abc[0] == 2.5;
    if (std::abs(i_a) < 2.5) largest_error = std::max(largest_error, std::abs(i_abc[0] - i_a));
  }
  EXPECT_LE(largest_error, 0.125 + 1e-6);
  EXPECT_GT(largest_error, 0.06);
  EXPECT_GT(clipped, 10);
  EXPECT_LT(clipped, 90);
}

// A sensor's error is in what it reads: the current of then, times its gain.
TEST(SignalLag, OfACurrentSensorWithAGainShowsTheCurrentOfThenTimesIt) {
  const double delay = 3.3e-4;
  Plant plant = plant_with(lag("current", "delay", delay) +
                           "[[effect]]\nkind = \"current_gain\"\ngain_a = 0.25\ngain_b = 0.0\n");
  std::vector<double> i{0};
  for (std::int64_t k = 0; k < 40; ++k) {
    tick(plant);
    i.push_back(circuit(i.back(), voltage(k), kTs));
    const double then =
        k < 1 ? 0
              : circuit(i[static_cast<std::size_t>(k - 1)], voltage(k - 1), kTs - (delay - kTs));
    EXPECT_NEAR(plant.sample().i_abc[0], 1.25 * then, 1e-5) << k;
    EXPECT_NEAR(plant.sample().i_abc[1], -0.5 * then, 1e-5) << k;
  }
}

TEST(SignalLag, OfFirstOrderIsADelayAndATimeConstantThatAddUpToTheLag) {
  SamplingFacts facts;
  test::effect_of("signal_lag", {{"signal", 1}, {"form", 1}, {"lag_s", 1e-3}, {"delay_share", 0.3}})
      ->describe_sampling(facts);
  EXPECT_NEAR(facts.delay[SamplingFacts::kCurrent], 0.3e-3, 1e-15);
  EXPECT_NEAR(facts.lowpass[SamplingFacts::kCurrent], 0.7e-3, 1e-15);
}

struct Rows {
  int missing = 0, repeated = 0;
  std::vector<std::int64_t> which;
};
Rows rows_of(Plant plant) {
  Rows rows;
  Measurement before = plant.sample();
  for (int k = 0; k < 5000; ++k) {
    tick(plant);
    const Measurement m = plant.sample();
    EXPECT_NEAR(m.u_alphabeta[0], voltage(k), 1e-9);
    const bool repeats = m.i_abc == before.i_abc;
    const bool missing = m.signals == kVoltage;
    EXPECT_TRUE(repeats || !missing);
    if (repeats || missing) rows.which.push_back(m.k);
    rows.missing += missing;
    rows.repeated += repeats && !missing;
    before = m;
  }
  return rows;
}

TEST(Rows, AreLostAndRepeatedAtTheirSharesByTheSeed) {
  const std::string both =
      "kind = \"missing_samples\"\nshare = 0.02\n[[effect]]\nkind = \"stale_samples\"\n"
      "share = 0.05\n";
  const Rows rows = rows_of(plant_with(both));
  EXPECT_NEAR(rows.missing, 100, 40);  // four sigma
  EXPECT_NEAR(rows.repeated, 245, 61);
  EXPECT_EQ(rows_of(plant_with(both)).which, rows.which);
  EXPECT_NE(rows_of(plant_with(both, "[run]\nseed = 2\n")).which, rows.which);
  const Rows none = rows_of(plant_with("kind = \"missing_samples\"\nshare = 0.0\n"));
  EXPECT_EQ(none.missing + none.repeated, 0);
}

TEST(Rows, OfWhichTheCurrentsAloneRepeatGoOnOtherwise) {
  SamplingFacts facts;
  test::effect_of("stale_samples", {{"share", 0.05}, {"signal", 1}})->describe_sampling(facts);
  EXPECT_EQ(facts.stale, 0);
  const SampleErrors errors(facts, kTs, 1);
  int held = 0;
  Measurement before;
  for (int k = 1; k <= 5000; ++k) {
    Measurement m{.k = k};
    m.i_abc.setConstant(k);
    m.theta_m = m.omega_m = m.v_dc = k;
    errors.spoil_row(m, before);
    held += m.i_abc == before.i_abc;
    ASSERT_EQ(m.theta_m, k);
    ASSERT_EQ(m.omega_m, k);
    ASSERT_EQ(m.v_dc, k);
    before = m;
  }
  EXPECT_NEAR(held, 250, 62);  // four sigma
}

TEST(SampleErrors, DoNotAllocate) {
  Plant plant = plant_with(lag("current", "delay", 3.3e-4) + "[[effect]]\n" +
                           lag("voltage", "first_order", 1e-4) + "[[effect]]\n" +
                           "kind = \"stale_samples\"\nshare = 0.1\n");
  for (int k = 0; k < 10; ++k) tick(plant);
  const auto before = test::allocation_count();
  for (int k = 0; k < 100; ++k) {
    plant.take_command({.k = plant.k(), .u_alphabeta_ref = {1, 0}});
    plant.advance();
    plant.sample();
  }
  EXPECT_EQ(test::allocation_count(), before);
}

}  // namespace
}  // namespace twinrate::sample_errors_test

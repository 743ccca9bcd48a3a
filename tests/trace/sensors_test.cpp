// The steps of an encoder are found, a reading stands at the centre of its cell, and what half a
// count would make is not taken for an effect.
#include "trace/sensors.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "model/frames.hpp"
#include "tests/trace/fitted_drive.hpp"
#include "trace/doubts.hpp"
#include "trace/gate.hpp"
#include "trace/rounding.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr double kRows = 20000, kT_s = 1e-4;

double swing(double t) {
  return 3 * std::sin(2.1 * t) + 0.7 * std::sin(13 * t + 1);
}

// Readings of an encoder that rounds down, whose zero is `zero` of a count off the first cell's.
Sensor steps_of(int counts, double zero = 0, double digit = 0) {
  AngleSteps steps;
  const double lsb = kTwoPi / counts;
  for (double k = 0; k < kRows; ++k) {
    double reading = (std::floor(swing(kT_s * k) / lsb) + zero) * lsb;
    if (digit > 0) reading = digit * std::round(reading / digit);
    steps.add(reading);
  }
  return steps.sensor();
}

TEST(AngleSteps, AreFoundFromCoarseToFine) {
  for (const int counts : {512, 1440, 4096, 20000, 65536}) {
    const Sensor found = steps_of(counts);
    EXPECT_EQ(found.counts(), counts);
    EXPECT_DOUBLE_EQ(found.centre, found.lsb / 2);
  }
}

TEST(AngleSteps, AreFoundWhereverTheZeroIsAndWithSixDigits) {
  EXPECT_EQ(steps_of(4096, 0.3).counts(), 4096);
  EXPECT_EQ(steps_of(8192, 0, 1e-6).counts(), 8192);
}

// A file of four decimals: each turn rounds the readings of a count to other digits.
TEST(AngleSteps, AreFoundInAFileOfFewDigits) {
  for (const int counts : {512, 1024, 4096}) {
    const Sensor found = steps_of(counts, 0, 1e-4);
    EXPECT_EQ(found.counts(), counts);
    EXPECT_NEAR(found.centre, found.lsb / 2, 1e-12);
  }
  // The digits of an exact angle are rounded to the nearest.
  const Sensor exact = steps_of(1 << 22, 0, 1e-4);
  EXPECT_EQ(exact.centre, 0);
  EXPECT_TRUE(exact.lsb == 0 || std::abs(exact.lsb - 1e-4) < 1e-12) << exact.lsb;
}

TEST(AngleSteps, OfReadingsThatStandAtCentresMoveNothing) {
  const Sensor found = steps_of(4096, 0.5);
  EXPECT_EQ(found.counts(), 4096);
  EXPECT_EQ(found.centre, 0);
}

TEST(AngleSteps, AreNoneWhereTheAngleIsExactOrTurnsLikeAClock) {
  AngleSteps exact, clock, fine;
  for (double k = 0; k < kRows; ++k) {
    exact.add(swing(kT_s * k));
    clock.add(kTwoPi / 1000 * k);
    fine.add(kTwoPi / (1 << 20) * std::floor(swing(kT_s * k) / kTwoPi * (1 << 20)));
  }
  EXPECT_EQ(exact.sensor().lsb, 0);
  EXPECT_EQ(clock.sensor().lsb, 0);
  EXPECT_EQ(fine.sensor().lsb, 0);
}

// A count each row, and one more at every thirty-sixth: readings that miss rows of a clock look the same.
TEST(AngleSteps, OfARotorThatTurnsByACountEachRowAreTheDeclared) {
  constexpr int kCounts = 1440;
  const auto turning = [](int declared, double noise) {
    AngleSteps steps(declared);
    const double lsb = kTwoPi / kCounts;
    for (double k = 0; k < kRows; ++k)
      steps.add(std::fmod(lsb * (std::floor(1.0277 * k + 0.3) + noise * std::sin(k)), kTwoPi));
    return steps.sensor();
  };
  EXPECT_EQ(turning(kCounts, 0).counts(), kCounts);
  EXPECT_EQ(turning(0, 0).counts(), 0) << "nothing says that it is an encoder";
  EXPECT_EQ(turning(1000, 0).counts(), 0) << "the readings do not keep to these counts";
  EXPECT_EQ(turning(kCounts, 0.3).counts(), 0) << "nor these";
}

// Thirty-four counts a row, less one at every fortieth: a drive at constant speed.
TEST(AngleSteps, AreFoundWhereAClockSlipsByOneNowAndThen) {
  const double lsb = kTwoPi / 8192;
  AngleSteps steps, uneven;
  double slipped = 0;
  for (double k = 0; k < 4000; ++k) {
    const double angle = (33.975 * k + 0.3) * lsb;
    steps.add(std::fmod(lsb * std::floor(angle / lsb), kTwoPi));
    slipped += std::fmod(k, 40) == 0 ? lsb * (1 + 0.3 * std::sin(k)) : 0;  // a clock that is hit
    uneven.add(std::fmod(34 * lsb * k - slipped, kTwoPi));
  }
  EXPECT_EQ(steps.sensor().counts(), 8192);
  EXPECT_EQ(uneven.sensor().lsb, 0);
}

// It starts slowly, and then turns by a count a row. In the start the readings keep to the counts,
// where those of a clock would lie between them.
TEST(AngleSteps, AreFoundWhereTheRotorStartsAndThenTurnsByACountEachRow) {
  const double lsb = kTwoPi / 512;
  AngleSteps counter, exact;
  double angle = 0;
  for (double k = 0; k < 10 * kRows; ++k) {
    angle += 0.996 * std::min(1.0, k / kRows) * lsb;
    counter.add(std::fmod(lsb * std::floor(angle / lsb), kTwoPi));
    exact.add(std::fmod(angle, kTwoPi));
  }
  EXPECT_EQ(counter.sensor().counts(), 512);
  EXPECT_EQ(exact.sensor().lsb, 0);
}

// Drawn errors against those of an encoder on the motion `speed` swings, at most so many counts a row.
struct Drawn {
  double size = 0, correlation = 0, true_lag = 0,
         drawn_lag = 0;  // lag: product with the row before
};
Drawn drawn_for(double counts_a_row) {
  const double lsb = kTwoPi / 4096, step = counts_a_row * lsb / kT_s / 15;
  std::vector<double> readings, errors;
  for (double k = 0; k < kRows; ++k) {
    const double angle = step * swing(kT_s * k);
    readings.push_back((std::floor(angle / lsb) + 0.5) * lsb);
    errors.push_back(readings.back() - angle);
  }
  const std::vector<double> drawn = drawn_rounding(readings, lsb);
  double ee = 0, dd = 0, ed = 0, e1 = 0, d1 = 0;
  for (std::size_t k = 1; k < errors.size(); ++k) {
    ee += errors[k] * errors[k], dd += drawn[k] * drawn[k], ed += errors[k] * drawn[k];
    e1 += errors[k] * errors[k - 1], d1 += drawn[k] * drawn[k - 1];
  }
  return {std::sqrt(dd / ee), ed / std::sqrt(dd * ee), e1 / ee, d1 / dd};
}

// It starts, by several counts more from row to row, and then turns by 26 counts a row. An exact angle that does the
// same shows no steps, nor does a clock of which rows repeat.
TEST(AngleSteps, AreFoundWhereTheRotorStartsAndThenTurnsLikeAClock) {
  constexpr int kCounts = 16384, kRow = 26;
  const double lsb = kTwoPi / kCounts;
  AngleSteps counter, exact, repeats;
  double at = 0;
  for (int k = 0; k < 3000; ++k) {
    at += std::min<double>(kRow, 0.37 * k);
    counter.add(std::fmod(lsb * std::floor(at), kTwoPi));
    exact.add(std::fmod(lsb * at, kTwoPi));
    repeats.add(std::fmod(lsb * kRow * (k - (k % 60 == 7)), kTwoPi));
  }
  EXPECT_EQ(counter.sensor().counts(), kCounts);
  EXPECT_EQ(exact.sensor().counts(), 0);
  EXPECT_EQ(repeats.sensor().counts(), 0);
}

TEST(DrawnRounding, HasTheSizeAndTheColourOfTheEncodersErrorsAndIsNotThem) {
  for (const double counts_a_row : {0.03, 0.3, 1.0, 4.0}) {
    const Drawn drawn = drawn_for(counts_a_row);
    EXPECT_NEAR(drawn.size, 1, 0.05) << counts_a_row;
    EXPECT_NEAR(drawn.correlation, 0, 0.1) << counts_a_row;
    EXPECT_NEAR(drawn.drawn_lag, drawn.true_lag, 0.1) << counts_a_row;
  }
}

// The rms of means over 30 rows: what is slow in an error.
double slow_part(const std::vector<double>& x) {
  constexpr std::size_t kMean = 30;
  double sum = 0, power = 0, count = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    sum += x[k];
    if (k % kMean != kMean - 1) continue;
    power += sum * sum / (kMean * kMean), ++count;
    sum = 0;
  }
  return std::sqrt(power / count);
}

// Between two slips the readings step by one count exactly; only a long window shows the shaft there.
TEST(DrawnRounding, IsSlowWhereTheShaftPassesNearlyAWholeNumberOfCountsARow) {
  const double lsb = kTwoPi / 1440;
  for (const double counts_a_row : {1.004, 0.497, 2.006}) {
    std::vector<double> readings, errors;
    for (double k = 0; k < 10000; ++k) {
      const double angle = counts_a_row * lsb * k;
      readings.push_back((std::floor(angle / lsb) + 0.5) * lsb);
      errors.push_back(readings.back() - angle);
    }
    const std::vector<double> moved = moved_rounding(readings, lsb);
    const double ratio = slow_part(moved) / slow_part(errors);
    EXPECT_NEAR(ratio, 1, 0.25) << counts_a_row;
    double product = 0, own = 0, drawn = 0;
    for (std::size_t k = 0; k < errors.size(); ++k)
      product += moved[k] * errors[k], own += errors[k] * errors[k], drawn += moved[k] * moved[k];
    EXPECT_NEAR(product / std::sqrt(own * drawn), 0, 0.15) << counts_a_row;
    EXPECT_LT(slow_part(drawn_rounding(readings, lsb)), 0.25 * slow_part(errors)) << counts_a_row;
  }
}

// The drive file of a synthetic drive.
DriveConfig declared(const SyntheticDrive& d, bool with_counts) {
  std::vector<std::string> keys = {
      fmt::format("machine.R_s_Ohm={:.9g}", d.R),
      fmt::format("machine.L_d_H={:.9g}", d.L),
      fmt::format("machine.L_q_H={:.9g}", d.L),
      fmt::format("machine.psi_f_Wb={:.9g}", d.psi),
      fmt::format("machine.J_kgm2={:.9g}", d.J),
      fmt::format("machine.B_Nms={:.9g}", d.B),
      fmt::format("machine.n_p={}", d.n_p),
      "machine.T_rated_Nm=0.063",
      "machine.i_rated_A=2",
      "inverter.v_dc_V=24",
      fmt::format("sensors.encoder_counts={}", with_counts ? d.counts : 0)};
  return Config::parse(Config::load("niewiara2020").resolved_with({}), "test", keys).drive();
}

TraceResult trace_of(const SyntheticDrive& d, const DriveConfig& drive) {
  Health health;
  const Record record = make_record(simulate_synthetic(d), d.n_p, health);
  EXPECT_EQ(health.angle.counts(), d.counts);
  return trace_record(record, drive, health, {});
}

TraceResult trace_of(const SyntheticDrive& d, bool with_counts) {
  return trace_of(d, declared(d, with_counts));
}

std::string found_in(const SyntheticDrive& d, bool with_counts) {
  std::string found;
  for (const TracedEffect& e : trace_of(d, with_counts).effects)
    found += std::string(e.effect->kind()) + " ";
  return found;
}

// The motor of dilys2021.
SyntheticDrive small_servo(int counts) {
  return {.R = 1.2,
          .L = 0.5e-3,
          .psi = 0.007,
          .J = 1e-5,
          .B = 1e-5,
          .n_p = 4,
          .T_s = 2e-4,
          .duration_s = 3,
          .i_noise = 0.0245,
          .lsb = 0.004,
          .counts = counts,
          .speeds = 1.5,
          .loads = 0.01,
          .i_d = 0.3};
}

// A flat motor of low inductance.
SyntheticDrive flat_motor(int counts) {
  return {.R = 0.9,
          .L = 0.26e-3,
          .psi = 0.0052,
          .J = 1.05e-5,
          .B = 2e-6,
          .n_p = 7,
          .duration_s = 3,
          .i_noise = 0.001,
          .lsb = 0.0005,
          .counts = counts,
          .speeds = 2,
          .loads = 0.03,
          .i_d = 0};
}

TEST(Encoder, HalfACountIsNoOffset) {
  EXPECT_EQ(found_in(small_servo(1440), true), "");
}

TEST(Encoder, HalfACountIsNoInductanceNorLag) {
  for (const int counts : {4096, 2048}) EXPECT_EQ(found_in(flat_motor(counts), true), "");
}

TEST(Encoder, ItsRoundingIsFoundWhereItIsNotDeclared) {
  SyntheticDrive down = flat_motor(4096), nearest = down;
  nearest.offset_theta = kPi / 4096;
  EXPECT_EQ(found_in(down, false), "");
  EXPECT_EQ(found_in(nearest, false), "");
}

bool says_nearest(const TraceResult& r) {
  return std::any_of(r.health.begin(), r.health.end(), [](const std::string& line) {
    return line.find("rounded to the nearest count") != std::string::npos;
  });
}

// Either error has a part along the EMF that half a count makes.
TEST(Encoder, ItsRoundingIsToldFromTheErrorOfAnEffect) {
  SyntheticDrive down = small_servo(1440), nearest = down;
  down.loads *= 12;
  DriveConfig declares_more = declared(down, false);
  declares_more.machine.L_q *= 1.5;
  const TraceResult lacks_inductance = trace_of(down, declares_more);
  EXPECT_FALSE(says_nearest(lacks_inductance));
  ASSERT_EQ(lacks_inductance.effects.size(), 1u) << lacks_inductance.sentence;
  EXPECT_EQ(lacks_inductance.effects.front().effect->kind(), "inductance");

  nearest.offset_theta = kPi / 1440;
  nearest.R_extra = 0.3 * nearest.R;
  EXPECT_TRUE(says_nearest(trace_of(nearest, false)));
}

TEST(Encoder, AZeroWithinHalfACountIsNoClaim) {
  SyntheticDrive drive = small_servo(1440);
  drive.offset_theta = -0.45 * kTwoPi / 1440;
  for (const bool with_counts : {true, false}) {
    const TraceResult r = trace_of(drive, with_counts);
    EXPECT_TRUE(r.effects.empty()) << r.sentence;
    // Nor is an offset shown to be absent.
    EXPECT_EQ(std::count(r.identifiable.begin(), r.identifiable.end(), "encoder_offset"), 0);
    EXPECT_EQ(std::count_if(r.not_identifiable.begin(), r.not_identifiable.end(),
                            [](const auto& kind) {
                              return kind.first == "encoder_offset" &&
                                     kind.second.starts_with("theta_m was moved");
                            }),
              1);
  }
}

TEST(Encoder, AnOffsetWithinACountIsAClaimWhereTheCountsAreDeclared) {
  SyntheticDrive drive = small_servo(1440);
  drive.offset_theta = 0.8 * kTwoPi / 1440;
  EXPECT_EQ(found_in(drive, true), "encoder_offset ");
  EXPECT_EQ(found_in(drive, false), "");
}

TEST(Encoder, AnOffsetOfSeveralCountsIsFound) {
  SyntheticDrive drive = small_servo(1440);
  drive.offset_theta = 3.3 * kTwoPi / 1440;
  for (const bool with_counts : {true, false})
    EXPECT_EQ(found_in(drive, with_counts), "encoder_offset ");
}

// Most of the energy of the torque is the noise of the counts.
TEST(Encoder, AFrictionWithLessEnergyThanTheNoiseOfTheCountsIsFound) {
  SyntheticDrive drive = small_servo(512);
  drive.extra_load = [](double, double, double omega) { return omega > 0 ? 8e-4 : -8e-4; };
  EXPECT_EQ(found_in(drive, true), "coulomb_friction ");
}

TEST(Encoder, WhatMayBeItsNoiseIsNotShownToBeAbsent) {
  SyntheticDrive drive = small_servo(512);
  drive.extra_load = [](double, double, double omega) { return 5e-6 * omega; };
  const TraceResult r = trace_of(drive, true);
  ASSERT_FALSE(r.refused.empty());
  EXPECT_EQ(r.refused.front().kind + " " + r.refused.front().rule, "viscous_friction sensors");
  EXPECT_EQ(std::count(r.identifiable.begin(), r.identifiable.end(), "viscous_friction"), 0);
}

// At rest for a tenth of the record, then as before.
// A shaft between the rotor and its load. `steady`: the speed varies by a tenth at most.
TraceResult trace_of_shaft(int counts, bool steady) {
  const LooseLoad shaft{.J = 3.2e-3, .K = 250, .D = 0.05, .gap = 0};
  RawLog raw = simulate_synthetic({.J = SyntheticDrive{}.J - shaft.J,
                                   .duration_s = steady ? 4.0 : 6.0,
                                   .extra_load = shaft,
                                   .counts = counts,
                                   .speeds = steady ? 0.2 : 1,
                                   .omega_more = steady ? 100.0 : 0});
  raw.drop_first(5000);  // the load settles
  Health health;
  const Record record = make_record(raw, servo().machine.n_p, health);
  return trace_record(record, servo(), health, {});
}

TEST(Encoder, AShaftIsToldFromCountsWhereTheSpeedChanges) {
  const TraceResult fine = trace_of_shaft(1048576, true), of_counts = trace_of_shaft(16384, true),
                    changing = trace_of_shaft(16384, false);
  for (const TraceResult* r : {&fine, &changing}) {
    ASSERT_EQ(r->effects.size(), 1u) << r->sentence;
    EXPECT_EQ(r->effects.front().effect->kind(), "torsion");
  }
  EXPECT_TRUE(of_counts.effects.empty());
  ASSERT_EQ(of_counts.refused.size(), 1u) << of_counts.sentence;
  EXPECT_EQ(of_counts.refused.front().kind, "torsion");
  EXPECT_EQ(of_counts.refused.front().rule, "sensors");
}

// Rule that refuses a true harmonic of the flux, from currents with a step of 0.3 A. `rounded`: the
// gate knows of the step.
std::string rule_of_harmonic(double amplitude_Wb, bool steady, bool rounded) {
  constexpr int kOrder = 6;
  const MachineParameters& m = servo().machine;
  RawLog raw = simulate_synthetic({.duration_s = 3,
                                   .i_noise = 0.1,
                                   .lsb = 0.3,
                                   .speeds = steady ? 0.01 : 0.3,
                                   .loads = 0,
                                   .i_d = 0,
                                   .omega_more = 60});
  for (std::size_t k = 0; k + 1 < raw.size(); ++k) {
    const double turn = raw.theta_m[k + 1] - raw.theta_m[k], mid = raw.theta_m[k] + turn / 2;
    const Vec2 u =
        inverse_park(amplitude_Wb * turn / SyntheticDrive{}.T_s *
                         Vec2(-kOrder * std::sin(kOrder * mid), m.n_p * std::cos(kOrder * mid)),
                     m.n_p * mid);
    raw.u_alpha[k] += u[0];
    raw.u_beta[k] += u[1];
  }
  const Members claim = {
      effect_with("flux_harmonics",
                  {{"order", double{kOrder}}, {"amplitude_Wb", amplitude_Wb}, {"phase_rad", 0}})};
  const FittedDrive drive(raw, claim);
  const Fitter fitter = drive.fitter();
  Gate gate(fitter, drive.chain(), {});
  gate.set_rounded(rounded);
  const Passed passed = gate(claim);
  return passed.refused.empty() ? "" : passed.refused.front().rule;
}

TEST(CurrentSensor, ALineOfTheVoltageIsToldFromItsStepsWhereTheSpeedChanges) {
  EXPECT_EQ(rule_of_harmonic(1e-3, true, false), "");
  EXPECT_EQ(rule_of_harmonic(1e-3, true, true), "sensors");
  EXPECT_EQ(rule_of_harmonic(1e-3, false, true), "");
  EXPECT_EQ(rule_of_harmonic(3e-3, true, true), "") << "half of the energy of the noise";
}

TEST(Encoder, SpeedChangesAroundAStart) {
  RawLog raw = simulate_synthetic({.duration_s = 2, .held = true});
  const std::size_t rows = raw.theta_m.size(), start = rows / 10;
  for (std::size_t k = 0; k < start; ++k) raw.theta_m[k] = raw.theta_m[start];
  Health health;
  const Record record = make_record(raw, servo().machine.n_p, health);
  const Equations equations(record, servo().facts());
  EXPECT_TRUE(at_constant_speed(equations)) << "more than half of its rows are";
  const Runs outputs{.row = {start - 2000, start - 500, start + 500, start + 2000},
                     .start = {0},
                     .held_out = {0, 0, 0, 0}};
  EXPECT_EQ(changing_speed(equations, outputs), (std::vector<char>{0, 1, 1, 0}));
}

}  // namespace
}  // namespace twinrate

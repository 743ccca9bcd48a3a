// A log whose units or conventions are not those of the drive file is told from a drive that lacks
// an effect. The logs are those of an independent drive model.
#include "trace/consistency.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/keys.hpp"
#include "trace/scale_factors.hpp"
#include "trace/slips.hpp"
#include "trace/tracer.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
namespace {

SyntheticDrive short_run() {
  return {.duration_s = 1.5};
}

const RawLog& plain_log() {
  static const RawLog kLog = simulate_synthetic(short_run());
  return kLog;
}

using Columns = std::vector<std::vector<double> RawLog::*>;
void scale(RawLog& raw, const Columns& columns, double factor) {
  for (const auto column : columns)
    for (double& x : raw.*column) x *= factor;
}
const Columns kCurrents = {&RawLog::i_a, &RawLog::i_b, &RawLog::i_c};
const Columns kVoltages = {&RawLog::u_alpha, &RawLog::u_beta};

// The same log with d, q columns.
RawLog in_rotor_axes(const RawLog& raw) {
  RawLog out = raw;
  for (std::size_t k = 0; k < raw.size(); ++k) {
    const double theta_e = servo().machine.n_p * raw.theta_m[k];
    const double i_c = raw.i_c.empty() ? -(raw.i_a[k] + raw.i_b[k]) : raw.i_c[k];
    const Vec2 i_dq = park(clarke({raw.i_a[k], raw.i_b[k], i_c}), theta_e);
    const Vec2 u_dq = park({raw.u_alpha[k], raw.u_beta[k]}, theta_e);
    out.i_d.push_back(i_dq[0]), out.i_q.push_back(i_dq[1]);
    out.u_d.push_back(u_dq[0]), out.u_q.push_back(u_dq[1]);
  }
  out.i_a = out.i_b = out.i_c = out.u_alpha = out.u_beta = {};
  return out;
}

std::vector<Inconsistency> found_in(const RawLog& raw, const DriveConfig& drive = servo()) {
  Health health;
  const Record record = make_record(raw, drive.machine.n_p, health);
  return inconsistencies(record, health, drive.facts(), drive.sensors.encoder_counts);
}

struct Mistake {
  const char* name;
  const char* quantity;
  const char* hint;
  std::function<void(RawLog&)> make;
  bool rotor_axes = false;
};

std::ostream& operator<<(std::ostream& out, const Mistake& mistake) {
  return out << mistake.name;
}

// Phase currents beside the voltages in the rotor's axes.
RawLog with_rotor_voltages(RawLog raw) {
  const RawLog d_q = in_rotor_axes(raw);
  raw.u_alpha = raw.u_beta = {}, raw.u_d = d_q.u_d, raw.u_q = d_q.u_q;
  return raw;
}

// What a loop with a coarse encoder makes of its speed: most of the rows' power.
void make_loud(RawLog& raw) {
  for (std::size_t k = 0; k < raw.size(); ++k) {
    raw.u_alpha[k] += 10 * normal(5, 1, k);
    raw.u_beta[k] += 10 * normal(5, 2, k);
  }
}

class Units : public testing::TestWithParam<Mistake> {};

TEST_P(Units, AreToldByQuantityAndFactor) {
  RawLog raw = GetParam().rotor_axes ? in_rotor_axes(plain_log()) : plain_log();
  GetParam().make(raw);
  const std::vector<Inconsistency> found = found_in(raw);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found.front().quantity, GetParam().quantity) << found.front().hint;
  EXPECT_NE(found.front().hint.find(GetParam().hint), std::string::npos) << found.front().hint;
}

constexpr double kDegree = kTwoPi / 360;
INSTANTIATE_TEST_SUITE_P(
    Of, Units,
    testing::Values(
        Mistake{"milliamperes", "i", "milliamperes", [](RawLog& r) { scale(r, kCurrents, 1e3); }},
        Mistake{"rms_currents", "i", "rms", [](RawLog& r) { scale(r, kCurrents, std::sqrt(0.5)); }},
        Mistake{"currents_out_of_the_motor", "i", "positive out of the motor",
                [](RawLog& r) { scale(r, kCurrents, -1); }},
        Mistake{"swapped_current_sensors", "i", "i_a and i_b swapped",
                [](RawLog& r) { std::swap(r.i_a, r.i_b); }},
        Mistake{"line_to_line_voltages", "u", "line-to-line",
                [](RawLog& r) { scale(r, kVoltages, std::sqrt(3.0)); }},
        Mistake{"rms_voltages", "u", "rms", [](RawLog& r) { scale(r, kVoltages, std::sqrt(0.5)); }},
        Mistake{"degrees", "theta_m", "degrees",
                [](RawLog& r) { scale(r, {&RawLog::theta_m}, 1 / kDegree); }},
        Mistake{"degrees_in_rotor_axes", "theta_m", "degrees",
                [](RawLog& r) { scale(r, {&RawLog::theta_m}, 1 / kDegree); }, true},
        Mistake{"degrees_beside_phase_currents", "theta_m", "degrees",
                [](RawLog& r) {
                  r = with_rotor_voltages(r);
                  for (double& x : r.theta_m) x = std::fmod(x + 20 * kTwoPi, kTwoPi) / kDegree;
                }},
        Mistake{"electrical_angle", "theta_m", "electrical angle",
                [](RawLog& r) { scale(r, {&RawLog::theta_m}, 3); }},
        Mistake{"reversed_angle", "theta_m", "reversed",
                [](RawLog& r) { scale(r, {&RawLog::theta_m}, -1); }},
        Mistake{"reversed_angle_in_rotor_axes", "theta_m", "reversed",
                [](RawLog& r) { scale(r, {&RawLog::theta_m}, -1); }, true},
        Mistake{"rms_currents_of_a_loud_voltage", "i", "rms",
                [](RawLog& r) { make_loud(r), scale(r, kCurrents, std::sqrt(0.5)); }},
        Mistake{"swapped_current_sensors_of_a_loud_voltage", "i", "i_a and i_b swapped",
                [](RawLog& r) { make_loud(r), std::swap(r.i_a, r.i_b); }},
        Mistake{"load_half", "T_load", "scale",
                [](RawLog& r) { scale(r, {&RawLog::T_load}, 0.5); }},
        Mistake{"angle_turned_of_the_currents", "theta_m", "90 degrees",
                [](RawLog& r) {
                  r = with_rotor_voltages(r);
                  for (double& x : r.theta_m) x += kTwoPi / 4 / servo().machine.n_p;
                }},
        Mistake{"angle_turned", "theta_m", "another zero",
                [](RawLog& r) {
                  for (double& x : r.theta_m) x += kTwoPi / 5 / servo().machine.n_p;
                }},
        Mistake{"angle_turned_by_a_phase", "theta_m", "order or sign of the phases",
                [](RawLog& r) {
                  for (double& x : r.theta_m) x += kTwoPi / 3 / servo().machine.n_p;
                }},
        Mistake{"angle_turned_by_half", "theta_m", "order or sign of the phases",
                [](RawLog& r) {
                  for (double& x : r.theta_m) x += 0.48 * kTwoPi / servo().machine.n_p;
                }},
        Mistake{"milliseconds", "t", "milliseconds",
                [](RawLog& r) { scale(r, {&RawLog::t}, 1e3); }},
        Mistake{"microseconds", "t", "microseconds",
                [](RawLog& r) { scale(r, {&RawLog::t}, 1e6); }},
        Mistake{"negative_bus", "v_dc", "sign", [](RawLog& r) { scale(r, {&RawLog::v_dc}, -1); }}),
    [](const auto& test) { return std::string(test.param.name); });

// K_t as a data sheet gives it: rms amperes, without 3/2, by poles instead of pole pairs.
TEST(Units, OfTheTorqueConstantAreToldByTheirFactor) {
  for (const auto& [factor, hint] :
       {std::pair(std::sqrt(2.0), "rms"), {std::sqrt(3.0), "line"}, {1.5, "3/2"}, {0.5, "poles"}}) {
    DriveConfig drive = servo();
    drive.machine.psi_f /= factor;
    const auto found = found_in(plain_log(), drive);
    ASSERT_EQ(found.size(), 1u) << factor;
    EXPECT_EQ(found.front().quantity, "psi_f") << factor;
    EXPECT_NE(found.front().hint.find(hint), std::string::npos) << found.front().hint;
  }
}

TEST(Units, OfPolePairsAreToldByTheFrame) {
  const auto expect_told = [](const RawLog& raw, int n_p, const char* hint) {
    DriveConfig drive = servo();
    drive.machine.n_p = n_p;
    const auto found = found_in(raw, drive);
    ASSERT_FALSE(found.empty()) << n_p;
    EXPECT_EQ(found.front().quantity, "n_p") << found.front().found << found.front().hint;
    EXPECT_NE(found.front().hint.find(hint), std::string::npos) << found.front().hint;
  };
  const int n_p = servo().machine.n_p;
  expect_told(plain_log(), 2 * n_p, "poles");
  expect_told(with_rotor_voltages(plain_log()), 2 * n_p, "poles");
  expect_told(plain_log(), n_p + 1, "miscounted");
}

TEST(Units, OfAngleAndCurrentAloneAreToldByTheTorque) {
  const RawLog plain = in_rotor_axes(plain_log());
  RawLog raw;
  raw.t = plain.t, raw.theta_m = plain.theta_m, raw.i_q = plain.i_q, raw.T_load = plain.T_load;
  EXPECT_TRUE(found_in(raw).empty());
  scale(raw, {&RawLog::i_q}, 1e3);
  const auto found = found_in(raw);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found.front().quantity, "i");
}

// Far larger than a working drive's, and no factor of a convention: another machine.
TEST(Units, AnotherMachineIsNoEffect) {
  DriveConfig drive = servo();
  drive.machine.psi_f *= 3.3, drive.machine.R_s *= 4, drive.machine.J *= 60;
  const auto found = found_in(plain_log(), drive);
  ASSERT_FALSE(found.empty());
  EXPECT_NE(found.front().hint.find("another machine"), std::string::npos);
}

// As large as effects of a working drive get, one and all together.
TEST(Units, EffectsOfAWorkingDriveAreConsistent) {
  const auto consistent = [](const SyntheticDrive& d) {
    const auto found = found_in(simulate_synthetic(d));
    return testing::AssertionResult(found.empty())
           << (found.empty() ? "" : found.front().quantity + " " + found.front().found);
  };
  EXPECT_TRUE(consistent(short_run()));
  SyntheticDrive d = short_run();
  d.R_extra = 0.6, d.psi *= 0.85, d.L *= 0.6, d.J *= 1.8;
  EXPECT_TRUE(consistent(d));
  d.loss_V = 4, d.offset_a = 0.3, d.offset_theta = 0.05;
  EXPECT_TRUE(consistent(d));
  d.slow = true;
  EXPECT_TRUE(consistent(d));
  d.quiet = true;
  EXPECT_TRUE(consistent(d));
}

// Every tenth row (or so): its voltage the mean of the ten, or that of its own tick.
Record decimated(bool mean, std::size_t each = 10, const RawLog& raw = plain_log()) {
  RawLog out;
  for (std::size_t k = 0; k + each <= raw.size(); k += each) {
    for (const auto column : {&RawLog::t, &RawLog::i_a, &RawLog::i_b, &RawLog::theta_m})
      (out.*column).push_back((raw.*column)[k]);
    for (const auto column : kVoltages) {
      double sum = 0;
      for (std::size_t j = 0; j < each; ++j) sum += (raw.*column)[k + j] / double(each);
      (out.*column).push_back(mean ? sum : (raw.*column)[k]);
    }
  }
  Health health;
  return make_record(out, servo().machine.n_p, health);
}

std::string told_of(const Record& record, const DriveConfig& drive = servo()) {
  const auto found = inconsistencies(record, {}, drive.facts(), drive.sensors.encoder_counts);
  return found.empty() ? "" : found.front().quantity + ": " + found.front().found;
}

// 15 ms: 3 rad electrical at full speed, and a mean keeps two thirds of the EMF.
TEST(Units, RowsBetweenWhichTheRotorTurnsFarAreThoseOfThisMachine) {
  const RawLog raw = simulate_synthetic({.duration_s = 6});
  const Record mean = decimated(true, 150, raw), tick = decimated(false, 150, raw);
  const ScaleFactors f = scale_factors(mean, servo().facts());
  EXPECT_GT(f.mean_interval_e, 1.2);
  EXPECT_NEAR(f.psi_f.value, 1, 0.02);
  EXPECT_NEAR(f.zero_e, 0, 0.02);
  EXPECT_EQ(told_of(mean), "");
  EXPECT_EQ(told_of(tick), "");
}

// The voltage equation holds between rows that the rotor turns little from; the others judge nothing.
TEST(Units, RowsBetweenWhichTheRotorTurnsFarHaveNoVoltageEquation) {
  const RawLog raw = simulate_synthetic({.L = 10e-3, .duration_s = 6, .speeds = 2});
  const TraceResult r = trace_record(decimated(true, 80, raw), servo(), {}, {});
  ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
  EXPECT_EQ(r.effects[0].effect->kind(), "inductance") << r.sentence;
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;  // the load is not in this log
  EXPECT_NE(r.health.back().find("% of the rows: the rotor turns by more than 1 rad"),
            std::string::npos)
      << r.health.back();
}

// An encoder whose count is 0.12 rad electrical puts more EMF into the other axis than this L has
// voltage.
TEST(Units, CountsOfACoarseEncoderAreNoInductance) {
  DriveConfig drive = servo();
  drive.machine.L_d = drive.machine.L_q = 4e-4, drive.machine.n_p = 10;
  SyntheticDrive d{.L = 4e-4, .n_p = 10, .duration_s = 6, .slow = true, .counts = 512};
  d.psi = drive.machine.psi_f;
  const RawLog raw = simulate_synthetic(d);
  Health health;
  const Record record = make_record(raw, drive.machine.n_p, health);
  EXPECT_GT(scale_factors(record, drive.facts()).L.log_sigma(), 0.2);
  EXPECT_EQ(told_of(record, drive), "");
}

// A speed loop answers an eccentric load in phase with the acceleration: a tenth of J, if it were asked.
TEST(Units, AHeldSpeedShowsNoInertia) {
  const DriveFacts facts = servo().facts();
  const MachineParameters& m = facts.machine;
  const auto ratio = [&](double swing) {  // of the speed
    Record record;
    record.T_s = 1e-3;
    for (std::size_t k = 0; k < 4000; ++k) {
      const double t = record.T_s * static_cast<double>(k), w = 100, slow = 5;
      const double theta_m = w * t - 0.02 * std::cos(w * t) - swing * w / slow * std::cos(slow * t);
      const double rate = 0.02 * w * w * std::cos(w * t),
                   move = swing * w * slow * std::cos(slow * t);
      const double i_q = (0.1 * m.J * rate + m.J * move) / m.torque_constant();
      record.t.push_back(t);
      record.theta_m.push_back(theta_m);
      record.i_alphabeta.push_back(inverse_park({0, i_q}, m.n_p * theta_m));
      record.motion_ok.push_back(1);
    }
    return scale_factors(record, facts).K_t_J;
  };
  EXPECT_FALSE(ratio(0).known());
  EXPECT_TRUE(ratio(0.5).known());
}

// At one speed, a load that drives the rotor has the currents of a friction with the other sign.
TEST(Units, ALoadThatDrivesTheRotorNeedsTheSignOfTheCurrents) {
  const MachineParameters& m = servo().machine;
  const auto traced = [&](double i_q, double swing) {
    RawLog raw;
    std::uint64_t draw = 0;
    const auto noise = [&] { return 2e-3 * normal(11, 0, draw++); };
    const double w = 100, slow = 4;
    for (std::size_t k = 0; k < 20'000; ++k) {
      const double t = 1e-4 * static_cast<double>(k), move = swing * w * slow * std::cos(slow * t);
      const double theta_m = w * t - swing * w / slow * std::cos(slow * t);
      const double torque = m.torque_constant() * i_q + m.J * move;
      const Vec3 i =
          inverse_clarke(inverse_park({0, torque / m.torque_constant()}, m.n_p * theta_m));
      raw.t.push_back(t);
      raw.theta_m.push_back(theta_m);
      raw.i_a.push_back(i[0] + noise()), raw.i_b.push_back(i[1] + noise());
    }
    Health health;
    const Record record = make_record(raw, m.n_p, health);
    return trace_record(record, servo(), health, {});
  };
  const TraceResult drives = traced(0.3, 0), brakes = traced(-0.3, 0), moves = traced(-0.3, 0.3);
  EXPECT_FALSE(drives.effects.empty()) << drives.sentence;
  EXPECT_TRUE(brakes.effects.empty()) << brakes.sentence;
  ASSERT_FALSE(brakes.refused.empty());
  EXPECT_EQ(brakes.refused[0].rule, "sign");
  EXPECT_EQ(brakes.verdict, "unexplained");
  // One mean, which no axis makes and which is there all the time.
  ASSERT_EQ(brakes.unexplained.size(), 1u);
  EXPECT_NE(brakes.unexplained[0].text.find("has another mean than zero"), std::string::npos)
      << brakes.unexplained[0].text;
  EXPECT_FALSE(moves.effects.empty()) << moves.sentence;
}

// At one speed and current, an L of ten times the machine's has the d voltage of an angle with another zero.
TEST(Units, ASlipThatExplainsAsMuchIsToldInThePlaceOfAnEffect) {
  const MachineParameters& m = servo().machine;
  const auto log = [&](double offset_e) {
    RawLog raw;
    std::uint64_t draw = 0;
    const auto noise = [&](double size) { return size * normal(12, 0, draw++); };
    const double omega_e = 100, i_q = m.B * omega_e / m.n_p / m.torque_constant();
    for (std::size_t k = 0; k < 20'000; ++k) {
      const double t = 1e-4 * static_cast<double>(k), theta_e = omega_e * t;
      const Vec2 u_dq(-omega_e * m.L_q * i_q, m.R_s * i_q + omega_e * m.psi_f);
      const Vec3 i = inverse_clarke(inverse_park({0, i_q}, theta_e));
      const Vec2 u = inverse_park(u_dq, theta_e + 0.5e-4 * omega_e);
      raw.t.push_back(t);
      raw.theta_m.push_back((theta_e + offset_e) / m.n_p);
      raw.i_a.push_back(i[0] + noise(2e-3)), raw.i_b.push_back(i[1] + noise(2e-3));
      raw.u_alpha.push_back(u[0] + noise(0.05)), raw.u_beta.push_back(u[1] + noise(0.05));
    }
    return raw;
  };
  const auto slip = [&](const RawLog& raw, const DriveConfig& drive) {
    Health health;
    return slip_that_fits(make_record(raw, drive.machine.n_p, health), drive.facts());
  };
  DriveConfig large = servo();
  large.machine.L_d = large.machine.L_q = 10 * m.L_q;
  const Slip of_L = slip(log(0), large);
  EXPECT_NE(of_L.text.find("L: ten times it in the drive file?"), std::string::npos) << of_L.text;
  EXPECT_TRUE(of_L.voltage);
  EXPECT_EQ(slip(log(0), servo()).text, "");
  EXPECT_EQ(slip(log(0.02), servo()).text, "");
  DriveConfig weak = servo();  // 1.2 times its EMF is not the voltage of another scale, 1.22
  weak.machine.psi_f /= 1.2;
  EXPECT_EQ(slip(log(0), weak).text, "");
  Health health;
  const TraceResult r = trace_record(make_record(log(0), m.n_p, health), large, health, {});
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
  EXPECT_NE(r.verdict, "nothing_missing");
}

// A slow rotor's voltage is mostly a loop's answer to noise; the magnet is where it should be.
TEST(Units, ALoudVoltageOfASlowRotorIsInTheRightFrame) {
  RawLog raw = simulate_synthetic({.duration_s = 6, .slow = true});
  for (std::size_t k = 0; k < raw.size(); ++k) {
    raw.u_alpha[k] += 1.2 * normal(5, 1, k);
    raw.u_beta[k] += 1.2 * normal(5, 2, k);
  }
  const Record record = decimated(false, 20, raw);
  const ScaleFactors f = scale_factors(record, servo().facts());
  EXPECT_LT(f.cell_share, 0.7);
  EXPECT_GT(f.emf_share, 0.3);
  EXPECT_EQ(told_of(record), "");
}

TEST(Units, OfTheVoltageOfATickNothingIsAssertedWhereNothingIsMissing) {
  EXPECT_FALSE(voltage_meaning(decimated(true), servo().facts()).of_tick);
  const Record of_tick = decimated(false);
  const VoltageMeaning meaning = voltage_meaning(of_tick, servo().facts());
  EXPECT_EQ(meaning.doubt, "");
  EXPECT_TRUE(meaning.of_tick);
  EXPECT_EQ(meaning.open_s, 2 * of_tick.T_s);
  const TraceResult r = trace_record(of_tick, servo(), {}, {});
  EXPECT_FALSE(r.electrical);
  for (const TracedEffect& e : r.effects) EXPECT_NE(e.equation, "electrical") << e.effect->kind();
}

// Ten ticks a row: nine tenths of half the turn between rows, to first order.
TEST(Units, TheVoltageOfATickTurnsBackwardsWithTheSpeed) {
  const DriveFacts facts = servo().facts();
  const Record mean = decimated(true), tick = decimated(false);
  EXPECT_NEAR(scale_factors(tick, facts).turned.value, -0.9, 0.2);
  EXPECT_NEAR(scale_factors(mean, facts, {.voltage_of_tick = true}).turned.value, 0.9, 0.2);
  EXPECT_NEAR(scale_factors(mean, facts).turned.value, 0, 0.05);
}

TEST(Units, TheVoltageOfATickShowsAResistanceThatIsMissing) {
  DriveConfig drive = servo();
  const double missing = 0.3 * drive.machine.R_s;
  drive.machine.R_s -= missing;
  const TraceResult r = trace_record(decimated(false), drive, {}, {});
  const auto found = std::find_if(r.effects.begin(), r.effects.end(), [](const TracedEffect& e) {
    return e.effect->kind() == "resistance";
  });
  ASSERT_NE(found, r.effects.end()) << r.sentence;
  EXPECT_NEAR(get_key(*found->effect, "change_Ohm"), missing, 0.25 * missing);
}

// An angle with another zero makes the wrong meaning fit the direction of the EMF, at one speed.
TEST(Units, AnotherZeroOfTheAngleDoesNotMakeAMeanTheVoltageOfATick) {
  Record record = decimated(true);
  const ScaleFactors f = scale_factors(record, servo().facts());
  for (double& theta_m : record.theta_m) theta_m += 0.5 * f.mean_interval_e / servo().machine.n_p;
  const ScaleFactors mean = scale_factors(record, servo().facts()),
                     tick = scale_factors(record, servo().facts(), {.voltage_of_tick = true});
  EXPECT_LT(std::abs(tick.zero_e), std::abs(mean.zero_e));
  EXPECT_FALSE(voltage_meaning(record, servo().facts()).of_tick);
}

TEST(Units, SpikesOfACurrentAreNoUnit) {
  const DriveFacts facts = servo().facts();
  std::vector<double> sizes(3000, 0.5 * facts.machine.i_rated);
  for (std::size_t k = 0; k < 6; ++k) sizes[400 * k] = 100 * facts.machine.i_rated;
  EXPECT_FALSE(far_current(sizes, facts));
  for (double& size : sizes) size *= 1000;
  EXPECT_TRUE(far_current(sizes, facts));
}

// A rotor that turns by 0.01 rad from row to row: a tick's voltage and the mean are 0.0045 rad apart,
// which no equation tells. The claim of an angle with another zero by as much is refused.
TEST(Units, ASlowRotorLeavesTheVoltagesFrameOpen) {
  const Record record = [] {
    constexpr std::size_t kEach = 10;
    SyntheticDrive drive{.duration_s = 6, .i_noise = 0.02, .speeds = 0.08};
    const RawLog raw = simulate_synthetic(drive);
    RawLog out;
    for (std::size_t k = 0; k + kEach <= raw.size(); k += kEach)
      for (const auto column : {&RawLog::t, &RawLog::i_a, &RawLog::i_b, &RawLog::theta_m,
                                &RawLog::u_alpha, &RawLog::u_beta})
        (out.*column).push_back((raw.*column)[k]);
    Health health;
    return make_record(out, servo().machine.n_p, health);
  }();
  const VoltageMeaning meaning = voltage_meaning(record, servo().facts());
  EXPECT_EQ(meaning.doubt, "");
  EXPECT_GT(meaning.open_e, 0.003);
}

TEST(Units, AreAskedForBeforeAnyEffect) {
  RawLog raw = plain_log();
  scale(raw, kCurrents, 1e3);
  Health health;
  const Record record = make_record(raw, servo().machine.n_p, health);
  const TraceResult r = trace_record(record, servo(), health, {});
  EXPECT_EQ(r.verdict, "inconsistent");
  EXPECT_TRUE(r.effects.empty());
  EXPECT_NE(r.sentence.find("milliamperes"), std::string::npos) << r.sentence;
}

}  // namespace
}  // namespace twinrate

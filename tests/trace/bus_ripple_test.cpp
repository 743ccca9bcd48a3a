// Ripple of the bus voltage, on synthetic columns of v_dc.
#include "trace/bus_ripple.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/bus_applied.hpp"
#include "trace/keys.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr double kBus = 235.4;  // V; 3e-3 of it are 0.706 V

using BusVoltage = std::function<double(double t, std::size_t k)>;

double bus_noise(std::uint64_t seed, std::size_t k) {
  return normal(seed, 5, k);
}
double sine_at(double f, double t, double phase) {
  return std::sin(2 * 3.14159265358979323846 * f * t + phase);
}

// A drive that reverses and is loaded, with this bus voltage in its log.
Record bus_record(const BusVoltage& v_dc, double duration_s = 4) {
  static const RawLog drive = simulate_synthetic({.duration_s = 8});
  Record record;
  record.T_s = 1e-4;
  for (std::size_t k = 0; static_cast<double>(k) * 1e-4 < duration_s; ++k) {
    record.t.push_back(drive.t[k]);
    record.theta_m.push_back(drive.theta_m[k]);
    record.i_alphabeta.push_back(
        clarke({drive.i_a[k], drive.i_b[k], -drive.i_a[k] - drive.i_b[k]}));
    record.u_alphabeta.push_back({drive.u_alpha[k], drive.u_beta[k]});
    record.v_dc.push_back(v_dc(drive.t[k], k));
    record.electrical_ok.push_back(1);
    record.motion_ok.push_back(1);
  }
  return record;
}

BusRipple ripple_in(const Record& record, const Effects& known = {}) {
  return find_bus_ripple(record, held_out_rows(record, 0.25, 3), servo().facts(), known);
}

double ripple_key(const TracedEffect& e, const char* name) {
  return get_key(*e.effect, name);
}
double ripple_sigma(const TracedEffect& e, const std::string& name) {
  for (const TracedParameter& p : e.parameters)
    if (p.name == name) return p.sigma.value_or(0);
  return 0;
}

TEST(BusRipple, IsFoundAtAnyFrequencyWithHonestSigmas) {
  double squares = 0;
  int count = 0;
  for (const double f : {50.0, 100.0, 137.31, 300.0, 613.77})
    for (const std::uint64_t seed : {1, 2, 3}) {
      const double A = 2 + static_cast<double>(seed), phase = 0.9 * static_cast<double>(seed) - 2;
      const BusRipple found = ripple_in(bus_record([&](double t, std::size_t k) {
        return kBus + A * sine_at(f, t, phase) + 0.5 * bus_noise(seed, k);
      }));
      ASSERT_EQ(found.effects.size(), 1u) << f;
      const TracedEffect& e = found.effects[0];
      for (const auto& [name, unit, truth] :
           {std::tuple{"amplitude", "_V", A}, {"frequency", "_Hz", f}, {"phase", "_rad", phase}}) {
        const double off =
            (ripple_key(e, (std::string(name) + unit).c_str()) - truth) / ripple_sigma(e, name);
        EXPECT_LT(std::abs(off), 4) << name << " at " << f;
        squares += off * off;
        ++count;
      }
      EXPECT_LT(ripple_sigma(e, "amplitude"), 0.02);
      EXPECT_LT(e.delta_bic, -1000);
      EXPECT_GT(e.held_out_gain, 0.8);
      EXPECT_LT(e.p_value, 1e-100);
      EXPECT_NEAR(found.error->after.held_out, 0.5, 0.02);
      EXPECT_TRUE(found.notes.empty());
    }
  EXPECT_GT(squares / count, 0.5);
  EXPECT_LT(squares / count, 1.7);
}

TEST(BusRipple, IsNotNamedWhereTheBusSagsDriftsJumpsOrIsNoisy) {
  const Record drive = bus_record([](double, std::size_t) { return kBus; });
  const auto power = [&](std::size_t k) {
    return 1.5 * drive.u_alphabeta[k].dot(drive.i_alphabeta[k]);
  };
  double sagged = 0;
  const std::vector<std::pair<const char*, BusVoltage>> buses = {
      {"noise", [](double, std::size_t k) { return kBus + 2 * bus_noise(4, k); }},
      {"much noise", [](double, std::size_t k) { return kBus + 20 * bus_noise(5, k); }},
      {"sag",
       [&](double, std::size_t k) { return kBus - 0.05 * power(k) + 0.2 * bus_noise(6, k); }},
      {"sag of a capacitor",
       [&](double, std::size_t k) {
         sagged += 1e-4 / 5e-3 * (0.1 * power(k) - sagged);
         return kBus - sagged + 0.2 * bus_noise(7, k);
       }},
      {"drift", [](double t, std::size_t k) { return kBus - 6 * t + 0.2 * bus_noise(8, k); }},
      {"steps",
       [](double t, std::size_t k) {
         return kBus + (t > 1.3 ? 12.0 : 0.0) - (t > 2.7 ? 20.0 : 0.0) + 0.2 * bus_noise(9, k);
       }},
      {"a chopper, now and then",
       [](double t, std::size_t k) {
         return kBus +
                15 * std::abs(std::fmod(t + 0.02 * std::sin(40 * t * t), 0.37) / 0.37 - 0.5) +
                0.2 * bus_noise(10, k);
       }},
      {"coarse steps",
       [](double t, std::size_t k) { return std::round(kBus + 3 * t + 0.1 * bus_noise(11, k)); }}};
  for (const auto& [name, bus] : buses) {
    sagged = 0;
    const BusRipple found = ripple_in(bus_record(bus));
    EXPECT_TRUE(found.effects.empty()) << name;
    EXPECT_FALSE(found.error.has_value()) << name;
    EXPECT_EQ(found.blind, "") << name;
  }
}

TEST(BusRipple, CountsFromTheSmallestWorthReportingOn) {
  const auto of = [](double A) {
    return ripple_in(bus_record([=](double t, std::size_t k) {
             return kBus + A * sine_at(300, t, 0.4) + 0.2 * bus_noise(12, k);
           }))
        .effects.size();
  };
  EXPECT_EQ(of(0.6), 0u);
  EXPECT_EQ(of(0.8), 1u);
}

TEST(BusRipple, IsFoundInOneSecond) {
  for (const double f : {47.0, 50.0, 137.31, 300.0, 571.3, 613.77}) {
    const BusRipple found = ripple_in(bus_record(
        [=](double t, std::size_t k) {
          return kBus + 2 * sine_at(f, t, 1) + 0.3 * bus_noise(19, k);
        },
        1));
    ASSERT_EQ(found.effects.size(), 1u) << f;
    const TracedEffect& e = found.effects[0];
    EXPECT_LT(std::abs(ripple_key(e, "frequency_Hz") - f), 4 * ripple_sigma(e, "frequency")) << f;
    EXPECT_LT(std::abs(ripple_key(e, "amplitude_V") - 2), 4 * ripple_sigma(e, "amplitude")) << f;
  }
}

TEST(BusRipple, HarmonicsAreAnEffectEach) {
  const BusRipple found = ripple_in(bus_record([](double t, std::size_t k) {
    return kBus + 9 * sine_at(300, t, 1) + 2 * sine_at(600, t, -2) + 0.3 * bus_noise(13, k);
  }));
  ASSERT_EQ(found.effects.size(), 2u);
  EXPECT_NEAR(ripple_key(found.effects[0], "amplitude_V"), 9, 0.02);
  EXPECT_NEAR(ripple_key(found.effects[1], "amplitude_V"), 2, 0.02);
  EXPECT_NEAR(ripple_key(found.effects[1], "frequency_Hz"), 600, 0.01);
  EXPECT_NEAR(ripple_key(found.effects[1], "phase_rad"), -2, 0.03);
  EXPECT_GT(found.effects[1].held_out_gain, 0.8) << "of what the first leaves";
}

// The power oscillates at 90 Hz and the bus sags with it.
TEST(BusRipple, OfTheDrivesOwnPowerIsNotNamed) {
  const auto bus = [](double slope) {
    Record record = bus_record([](double, std::size_t) { return kBus; });
    for (std::size_t k = 0; k < record.size(); ++k) {
      const double swing = sine_at(90, record.t[k], 0.3);
      record.i_alphabeta[k] *= 1 + 0.5 * swing;
      const double power = 1.5 * record.u_alphabeta[k].dot(record.i_alphabeta[k]) + 200 * swing;
      record.i_alphabeta[k] += 200 * swing * record.u_alphabeta[k] /
                               (1.5 * std::max(1.0, record.u_alphabeta[k].squaredNorm()));
      record.v_dc[k] -= slope * power - 0.2 * bus_noise(14, k);
    }
    return record;
  };
  for (const double slope : {0.01, 0.03}) {
    const BusRipple found = ripple_in(bus(slope));
    EXPECT_TRUE(found.effects.empty()) << slope;
    EXPECT_FALSE(found.notes.empty()) << slope;
    for (const std::string& note : found.notes)
      EXPECT_NE(note.find("the power of the drive"), std::string::npos) << note;
  }
  // A far larger ripple in addition comes from the rectifier.
  Record record = bus(0.01);
  for (std::size_t k = 0; k < record.size(); ++k)
    record.v_dc[k] += 25 * sine_at(300, record.t[k], 2);
  const BusRipple found = ripple_in(record);
  ASSERT_EQ(found.effects.size(), 1u);
  EXPECT_NEAR(ripple_key(found.effects[0], "frequency_Hz"), 300, 0.01);
}

TEST(BusRipple, ThatIsDeclaredIsTakenOff) {
  const Record record = bus_record([](double t, std::size_t k) {
    return kBus + 9 * sine_at(300, t, 1) + 0.3 * bus_noise(15, k);
  });
  const auto known = make_effect("dc_bus_ripple");
  set_key(*known, "amplitude_V", 9);
  set_key(*known, "frequency_Hz", 300);
  set_key(*known, "phase_rad", 1);
  EXPECT_TRUE(ripple_in(record, {known}).effects.empty());
  set_key(*known, "amplitude_V", 7);
  const BusRipple rest = ripple_in(record, {known});
  ASSERT_EQ(rest.effects.size(), 1u);
  EXPECT_NEAR(ripple_key(rest.effects[0], "amplitude_V"), 2, 0.05);
}

TEST(BusRipple, OfAFrequencyThatWandersIsSaidAndNotNamed) {
  double phase = 0;
  const BusRipple found = ripple_in(bus_record([&](double t, std::size_t k) {
    phase += 2 * 3.14159265358979323846 * 1e-4 * (300 + 0.8 * std::sin(1.1 * t));
    return kBus + 8 * std::sin(phase) + 0.3 * bus_noise(16, k);
  }));
  EXPECT_TRUE(found.effects.empty());
  ASSERT_EQ(found.notes.size(), 1u);
  EXPECT_NE(found.notes[0].find("no steady frequency"), std::string::npos);
}

TEST(BusRipple, ThatComesAndGoesIsRefused) {
  for (const double begin : {0.5, 1.5}) {
    const BusRipple found = ripple_in(bus_record([=](double t, std::size_t k) {
      const double A = t > begin && t < begin + 1.2 ? 6 : 0;
      return kBus + A * sine_at(300, t, 0.3) + 0.3 * bus_noise(20, k);
    }));
    EXPECT_TRUE(found.effects.empty()) << begin;
    EXPECT_FALSE(found.notes.empty()) << begin;
  }
}

TEST(BusRipple, OfTwoFilesHasAPhaseInEach) {
  const auto file = [](double phase, std::uint64_t seed) {
    return bus_record(
        [=](double t, std::size_t k) {
          return kBus + 6 * sine_at(299.6, t, phase) + 0.3 * bus_noise(seed, k);
        },
        3);
  };
  Record both = file(0.2, 17);
  Record second = file(0, 18);
  both.append(second);
  // Far from the phase by the clock of the first file.
  const double begin = both.t[both.size() - second.size()];
  both = file(0.2, 17);
  both.append(file(0.2 + kTwoPi * 299.6 * begin + 2.5, 18));
  const BusRipple found = ripple_in(both);
  ASSERT_EQ(found.effects.size(), 1u);
  EXPECT_NEAR(ripple_key(found.effects[0], "amplitude_V"), 6, 0.05);
  EXPECT_NEAR(ripple_key(found.effects[0], "frequency_Hz"), 299.6, 0.01);
  EXPECT_GT(found.effects[0].held_out_gain, 0.9);
}

TEST(BusRipple, WithoutAVaryingColumnSaysWhyItIsBlind) {
  Record record = bus_record([](double, std::size_t) { return kBus; });
  EXPECT_NE(ripple_in(record).blind.find("never changes"), std::string::npos);
  record.v_dc.clear();
  EXPECT_EQ(ripple_in(record).blind, "v_dc is not in the log");
}

TEST(BusRipple, LeavesOfTheVoltageItsMeanOverTheInterval) {
  const auto ripple = make_effect("dc_bus_ripple");
  set_key(*ripple, "amplitude_V", 20);
  set_key(*ripple, "frequency_Hz", 600);
  set_key(*ripple, "phase_rad", 0.7);
  const auto v = [](double t) { return kBus + 20 * sine_at(600, t, 0.7); };
  const Record record = bus_record([&](double t, std::size_t) { return v(t); }, 0.1);
  const Record applied = as_applied(record, {ripple});
  double largest = 0;
  for (std::size_t k = 0; k < record.size(); k += 7) {
    double mean = 0;
    for (int j = 0; j < 1000; ++j) mean += v(record.t[k] + (j + 0.5) * 1e-7) / 1000;
    const Vec2 wanted = record.u_alphabeta[k] * mean / v(record.t[k]);
    EXPECT_LT((applied.u_alphabeta[k] - wanted).norm(), 1e-5 * record.u_alphabeta[k].norm());
    largest = std::max(largest, std::abs(mean / v(record.t[k]) - 1));
    EXPECT_NEAR(applied.v_dc[k], kBus, 1e-9) << "without what effects add";
  }
  EXPECT_GT(largest, 0.01);
}

// The logged voltage is the one that acts. With a ripple it equals the reading of a meter; the
// voltage reference differs by the change of the ripple in the interval.
TEST(BusRipple, ActsOnTheMachineUnlessTheVoltageWasMeasured) {
  const auto ripple = make_effect("dc_bus_ripple");
  set_key(*ripple, "amplitude_V", 8);
  set_key(*ripple, "frequency_Hz", 300);
  const Record measured =
      bus_record([](double t, std::size_t) { return kBus + 8 * sine_at(300, t, 0); });
  const Record applied = as_applied(measured, {ripple});
  EXPECT_FALSE(acted(measured, applied, servo().machine));
  Record asked = measured;
  for (std::size_t k = 0; k < asked.size(); ++k)
    asked.u_alphabeta[k] *= measured.u_alphabeta[k].dot(applied.u_alphabeta[k]) > 0
                                ? measured.u_alphabeta[k].norm() / applied.u_alphabeta[k].norm()
                                : 1;
  EXPECT_TRUE(acted(asked, as_applied(asked, {ripple}), servo().machine));
}

}  // namespace
}  // namespace twinrate

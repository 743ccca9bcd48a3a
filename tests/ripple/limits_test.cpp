// The smooth drive at its limits: speed and load steps without windup, compensation through changes
// of speed and load.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/ripple/ripple.hpp"

namespace twinrate::test {
namespace {

constexpr double k50Rpm = 50 * kTwoPi / 60;

struct Trace {
  std::vector<double> t_s, omega_m, i_q;
  double T_s = 1e-4;
  // Largest and least over [from, to).
  std::pair<double, double> range(const std::vector<double>& values, double from_s,
                                  double to_s) const {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(from_s / T_s);
    const auto end = values.begin() + static_cast<std::ptrdiff_t>(to_s / T_s);
    const auto [least, largest] = std::minmax_element(begin, end);
    return {*least, *largest};
  }
  double rms_about(double omega_m_ref, double from_s, double to_s) const {
    double sum = 0;
    const auto first = static_cast<std::size_t>(from_s / T_s);
    const auto last = static_cast<std::size_t>(to_s / T_s);
    for (std::size_t i = first; i < last; ++i)
      sum += (omega_m[i] - omega_m_ref) * (omega_m[i] - omega_m_ref);
    return std::sqrt(sum / static_cast<double>(last - first));
  }
};

Trace run(double duration_s, const std::vector<std::string>& overrides) {
  Config config = load_drive("niewiara2020", overrides);
  ClosedLoop loop(config);
  Trace trace;
  for (std::int64_t k = 0; k < std::llround(duration_s / trace.T_s); ++k) {
    const Truth& truth = loop.step().truth;
    trace.t_s.push_back(static_cast<double>(k) * trace.T_s);
    trace.omega_m.push_back(truth.omega_m);
    trace.i_q.push_back(truth.i_dq[1]);
  }
  return trace;
}

// The voltage of one sample moves the current by at most this.
constexpr double kOneSample_A = 1e-4 / 12.7e-3 * 117.7;

TEST(Limits, AStepTo50RpmAndOneOf4NmSettleWithoutWindup) {
  for (const char* i_max_A : {"10", "5"}) {
    const Trace trace = run(
        2.5, {"reference.speed_rpm=50", "load.T_load_Nm=[[0.0, 0.0], [1.0, 4.0], [1.75, 0.0]]",
              "controller.compensation=paper", std::string("controller.lqr.i_max_A=") + i_max_A});
    const double i_max = std::stod(i_max_A);
    const auto [least_i_q, largest_i_q] = trace.range(trace.i_q, 0, 2.5);
    EXPECT_LT(largest_i_q, i_max + kOneSample_A) << i_max_A;
    EXPECT_GT(least_i_q, -i_max - kOneSample_A) << i_max_A;
    // The linear loop's own overshoot is 13 % (poles -44.5 +- 68j 1/s), the rest is ripple.
    EXPECT_LT(trace.range(trace.omega_m, 0, 1).second, 1.2 * k50Rpm) << i_max_A;
    // Back within the ripple a quarter of a second after each step.
    for (const double end_s : {1.0, 1.75, 2.5})
      EXPECT_LT(trace.rms_about(k50Rpm, end_s - 0.4, end_s), 0.1) << i_max_A << " at " << end_s;
    // 4 Nm need 3.5 A: the drive was loaded.
    EXPECT_GT(trace.range(trace.i_q, 1.5, 1.7).first, 3.0) << i_max_A;
  }
}

// A step of 300 rpm at a limit of 3 A, which a weak anti-windup does not pass.
TEST(Limits, CurrentReachesItsLimitWithoutWindup) {
  const double omega_m_ref = 300 * kTwoPi / 60;
  const auto step = [](const char* k_awu_rad_s) {
    return run(1.5, {"reference.speed_rpm=300", "controller.lqr.i_max_A=3", "effect=[]",
                     std::string("controller.lqr.k_awu_rad_s=") + k_awu_rad_s});
  };
  const Trace trace = step("50"), weak = step("5");
  const auto [least, largest] = trace.range(trace.i_q, 0.02, 0.05);
  EXPECT_GT(least, 2.9);
  EXPECT_LT(largest, 3.05);
  EXPECT_LT(trace.range(trace.omega_m, 0, 1.5).second, 1.06 * omega_m_ref);
  EXPECT_GT(weak.range(weak.omega_m, 0, 1.5).second, 1.2 * omega_m_ref);
  EXPECT_LT(trace.rms_about(omega_m_ref, 1.3, 1.5), 0.05);
}

// 5 to 200 rpm up and down again while it learns, and with the inertia off. Without compensation
// nothing is learnt, so each speed is reached once and held for four seconds.
TEST(AngleDomainDrive, IsStableThroughASweepOfSpeeds) {
  for (const double change_kgm2 : {0.0, -0.3 * 8.8e-3, 0.3 * 8.8e-3}) {
    const std::string effects = fmt::format(
        "effect=[{{kind=\"inertia\",change_kgm2={}}},"
        "{{kind=\"cogging\",order=6,amplitude_Nm=0.03}},"
        "{{kind=\"cogging\",order=27,amplitude_Nm=0.04}},"
        "{{kind=\"cogging\",order=54,amplitude_Nm=0.06}},"
        "{{kind=\"dead_time\",dead_time_s=1e-6}},"
        "{{kind=\"coulomb_friction\",torque_Nm=0.25}}]",
        change_kgm2);
    const Trace on = run(56, {effects, "controller.compensation=angle_domain",
                              "reference.speed_rpm=[[0.0,5],[13.0,20],[23.0,50],[31.0,100],[36.0,"
                              "200],[41.0,50],[49.0,20]"
                              "]"});
    const Trace off = run(18, {effects, "controller.compensation=off",
                               "reference.speed_rpm=[[0.0,20],[6.0,50],[10.0,100],[14.0,200]]"});
    struct Stretch {
      double rpm, from_s, to_s, off_from_s, off_to_s;
    };
    for (const Stretch& at : {Stretch{50, 28, 31, 7, 10},
                              {100, 34, 36, 12, 14},
                              {200, 39, 41, 16, 18},
                              {50, 45, 49, 7, 10},
                              {20, 52, 56, 2, 6}}) {
      const double omega_m_ref = at.rpm * kTwoPi / 60;
      EXPECT_LT(on.rms_about(omega_m_ref, at.from_s, at.to_s),
                0.5 * off.rms_about(omega_m_ref, at.off_from_s, at.off_to_s))
          << at.rpm << " rpm, J " << change_kgm2;
    }
    // Back at 50 rpm it still has the table learnt there.
    EXPECT_LT(on.rms_about(k50Rpm, 45, 49), 0.1 * off.rms_about(k50Rpm, 7, 10)) << change_kgm2;
  }
}

TEST(AngleDomainDrive, SurvivesALoadStepOfHalfTheRatedTorque) {
  // Without compensation the ripple is periodic from the first second on.
  const auto at_50 = [&](const char* compensation, double step_s, double end_s) {
    return run(end_s, {"reference.speed_rpm=50",
                       fmt::format("load.T_load_Nm=[[0.0, 0.0], [{:.1f}, 4.05]]", step_s),
                       std::string("controller.compensation=") + compensation});
  };
  const Trace on = at_50("angle_domain", 20, 56), off = at_50("off", 6, 14);
  EXPECT_LT(on.rms_about(k50Rpm, 16, 20), 0.1 * off.rms_about(k50Rpm, 2, 6));
  EXPECT_LT(on.rms_about(k50Rpm, 50, 56), 0.1 * off.rms_about(k50Rpm, 8, 14));
  // The speed dip of the loop rises by no more than the ripple.
  EXPECT_GT(on.range(on.omega_m, 20, 21).first, off.range(off.omega_m, 6, 7).first - 0.3);
}

}  // namespace
}  // namespace twinrate::test

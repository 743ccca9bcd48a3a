// A log of so few rows that the rotor turns by more than half a turn between two of them.
#include <gtest/gtest.h>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/keys.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr double kRow_s = 0.02;

// At constant speed, with the angle within one turn and the voltage of each row.
RawLog turning(double turn_a_row, bool with_speed, double angle_factor = 1,
               bool counts_turns = false) {
  const MachineParameters& m = servo().machine;
  const double omega_m = turn_a_row / kRow_s;
  RawLog raw;
  raw.path = "turning";
  double turned = 0;
  for (std::size_t k = 0; k < 600; ++k) {
    const double theta_e = m.n_p * turn_a_row * static_cast<double>(k);
    const Vec2 i_dq(0.01 * normal(3, 1, k), 0.5 + 0.01 * normal(3, 2, k));
    const Vec2 u_dq =
        m.R_s * i_dq + m.n_p * omega_m * Vec2(-m.L_q * i_dq[1], m.psi_f + m.L_d * i_dq[0]);
    const Vec3 i = inverse_clarke(inverse_park(i_dq, theta_e));
    const Vec2 u = inverse_park(u_dq, theta_e);
    raw.t.push_back(kRow_s * static_cast<double>(k));
    turned += k == 0 ? 0 : counts_turns ? turn_a_row : wrap_pi(turn_a_row);
    raw.theta_m.push_back(angle_factor * turned);
    raw.i_a.push_back(i[0]), raw.i_b.push_back(i[1]), raw.i_c.push_back(i[2]);
    raw.u_alpha.push_back(u[0]), raw.u_beta.push_back(u[1]);
    if (with_speed) raw.omega_m.push_back(omega_m);
  }
  return raw;
}

TraceResult traced_turns(const RawLog& raw) {
  Health health;
  const Record record = make_record(raw, servo().machine.n_p, health);
  return trace_record(record, servo(), health, {});
}

bool is_too_slow(const RawLog& raw) {
  const TraceResult r = traced_turns(raw);
  return r.verdict == "ambiguous" && r.effects.empty() &&
         r.sentence.starts_with("Cannot tell: the rows are too far apart");
}

TEST(HiddenTurns, AnAngleNearHalfATurnARowShowsNoDirection) {
  EXPECT_TRUE(is_too_slow(turning(2.8, false)));
  EXPECT_FALSE(is_too_slow(turning(2.8, true)));  // omega_m shows it
  EXPECT_FALSE(is_too_slow(turning(0.4, false)));
}

// 4.1 rad look like -2.2 rad.
TEST(HiddenTurns, TheSpeedOrTheVoltageShowThatTurnsAreHidden) {
  EXPECT_TRUE(is_too_slow(turning(4.1, true)));
  EXPECT_TRUE(is_too_slow(turning(4.1, false)));
}

TEST(HiddenTurns, AnAngleThatCountsTurnsHidesNone) {
  for (const bool with_speed : {false, true})
    EXPECT_FALSE(is_too_slow(turning(4.1, with_speed, 1, true))) << with_speed;
}

TEST(HiddenTurns, AnAngleInDegreesIsStillToldAsAUnit) {
  EXPECT_EQ(traced_turns(turning(0.1, false, 360 / kTwoPi)).verdict, "inconsistent");
}

}  // namespace
}  // namespace twinrate

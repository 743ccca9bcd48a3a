// Agreement of a filter with itself, on a machine whose currents are computed by hand: the stator flux
// of a salient rotor in steady state.
#include "estimator/agreement.hpp"

#include <gtest/gtest.h>

#include "estimator/two_rate.hpp"
#include "tests/support/probe_filter.hpp"

namespace twinrate::test {
namespace {

constexpr double kT_s = 1e-4, kOmega_e = 300;
constexpr int kTurn = 210;  // ticks: 2 pi/(omega_e T_s) = 209.4

MachineParameters salient() {
  MachineParameters m;
  m.R_s = 2;
  m.L_d = 5e-3;
  m.L_q = 9e-3;
  m.psi_f = 0.1;
  m.n_p = 3;
  return m;
}

// What a filter says about the true state (theta_e, omega_e): first sample to last.
struct Claim {
  double angle_error = 0;  // rad
  double sign = 1;         // of the speed
  Vec2 innov = Vec2::Zero();
  int status = 0;
  Mode mode = Mode::kRun;
};

// Ticks up to the agreement; -1: none in `ticks`.
int agrees_after(const Claim& claim, int ticks = 3 * kTurn, bool innov_turns = false) {
  const MachineParameters m = salient();
  const Vec2 i_dq(-1, 4);
  const auto i_at = [&](double theta) { return inverse_park(i_dq, theta); };
  const auto psi_at = [&](double theta) {
    return inverse_park(Vec2(m.L_d * i_dq[0] + m.psi_f, m.L_q * i_dq[1]), theta);
  };
  Agreement agreement(m, innov_turns, kT_s);
  for (int k = 0; k < ticks; ++k) {
    const double theta = kOmega_e * kT_s * k, before = theta - kOmega_e * kT_s;
    const Vec2 i = i_at(theta), i_before = i_at(before);
    Measurement sample;
    sample.k = k;
    sample.mode = claim.mode;
    sample.i_abc = inverse_clarke(i);
    sample.u_alphabeta = 0.5 * m.R_s * (i + i_before) + (psi_at(theta) - psi_at(before)) / kT_s;
    Estimate e;
    e.k = k;
    e.theta_e = wrap_turn(theta + claim.angle_error);
    if (claim.sign < 0) e.theta_e = wrap_turn(kPi - theta);  // turns the other way
    e.omega_m = claim.sign * kOmega_e / m.n_p;
    e.innov.head<2>() = innov_turns ? inverse_park(claim.innov, e.theta_e) : claim.innov;
    e.status = claim.status;
    if (agreement.step(e, sample)) return k;
  }
  return -1;
}

TEST(Agreement, ComesAfterOneTurnOfARightEstimate) {
  EXPECT_EQ(agrees_after({}), kTurn);
  EXPECT_EQ(agrees_after({.sign = 1}, kTurn), -1);
}

TEST(Agreement, AsksForTheAngleWithinSeventeenDegrees) {
  EXPECT_GT(agrees_after({.angle_error = 15 * kPi / 180}), 0);
  EXPECT_GT(agrees_after({.angle_error = -15 * kPi / 180}), 0);
  for (const double deg : {20.0, -20.0, 90.0, 180.0})
    EXPECT_EQ(agrees_after({.angle_error = deg * kPi / 180}), -1) << deg;
}

TEST(Agreement, DoesNotTakeTheMirroredState) {
  EXPECT_EQ(agrees_after({.sign = -1}, 10 * kTurn), -1);
}

// L_q innov/T_s against omega_e psi_a = 31.2 V: 0.3 of it are 0.104 A in q.
TEST(Agreement, AsksForSmallInnovationsInRotorAxes) {
  for (const bool turns : {false, true}) {
    EXPECT_GT(agrees_after({.innov = {0, 0.09}}, 3 * kTurn, turns), 0) << turns;
    EXPECT_EQ(agrees_after({.innov = {0, 0.12}}, 3 * kTurn, turns), -1) << turns;
  }
}

TEST(Agreement, WaitsWhileTheAngleIsForced) {
  EXPECT_EQ(agrees_after({.mode = Mode::kIfRamp}), -1);
  EXPECT_EQ(agrees_after({.mode = Mode::kAlign}), -1);
}

TEST(Agreement, OfAMeasuredAngleIsThereAtOnce) {
  EXPECT_EQ(agrees_after({.status = kMeasuredAngle}), 0);
}

// A filter that says the true angle of a rotor at constant speed, from tick `right_from` on.
class TurningProbe : public ProbeFilter {
 public:
  explicit TurningProbe(std::int64_t right_from) : right_from_(right_from) {}
  Estimate output(const FastState&, const Measurement& m) const override {
    Estimate e;
    const double wrong = m.k < right_from_ ? kPi / 2 : 0;
    e.theta_e = wrap_turn(kOmega_e * kT_s * static_cast<double>(m.k) + wrong);
    e.omega_m = kOmega_e / salient().n_p;
    return e;
  }

 private:
  std::int64_t right_from_;
};

// No current: the voltage is the EMF alone.
Measurement at_no_load(std::int64_t k) {
  const double theta_mid = kOmega_e * kT_s * (static_cast<double>(k) - 0.5);
  Measurement m;
  m.k = k;
  m.signals = kPhaseCurrents | kVoltage;
  m.u_alphabeta = inverse_park(Vec2(0, kOmega_e * salient().psi_f), theta_mid);
  return m;
}

class LocksFirst : public testing::TestWithParam<std::tuple<GainPolicy, int>> {};

// Each tick up to the next multiple of n after the agreement sends a gain and uses that of the tick
// before; from then on the rates are those of core/rates.hpp.
TEST_P(LocksFirst, GainsComeEveryTickUntilTheAgreementAndEveryNthAfterIt) {
  const auto [policy, n] = GetParam();
  const auto filter = std::make_shared<TurningProbe>(100);
  FastLoop fast(filter, policy, n, {}, Agreement(salient(), false, kT_s));
  BackgroundLoop background(filter, policy, n);
  std::int64_t from = BackgroundRate::kNotYet;
  for (std::int64_t k = 0; k < 1000; ++k) {
    ASSERT_TRUE(fast.gain_ready(k)) << k;
    const Estimate e = fast.tick(at_no_load(k));
    const bool every_tick = e.status & kGainEveryTick;
    if (!every_tick && from == BackgroundRate::kNotYet) from = k;
    EXPECT_EQ(every_tick, k < from) << k;
    EXPECT_EQ(e.status & kLateGain, 0) << k;
    EXPECT_EQ(e.gain_seq, snapshot_for_tick(policy, k, {n, from})) << k;
    if (!every_tick && k % n != 0) continue;
    EXPECT_EQ(background.next_k(), k);
    const Gain gain = background.step(e);
    EXPECT_EQ(gain.first_use, first_use_of(policy, k, {n, from})) << k;
    fast.take_gain(gain);
  }
  EXPECT_EQ(from % n, 0);
  EXPECT_GE(from, 100 + kTurn);  // the turn begun before tick 100 holds the wrong angle
  EXPECT_LE(from, 100 + 2 * kTurn + n);
  EXPECT_EQ(fast.rate().from, from);
}

INSTANTIATE_TEST_SUITE_P(Policies, LocksFirst,
                         testing::Combine(testing::Values(GainPolicy::kPaper,
                                                          GainPolicy::kImmediate,
                                                          GainPolicy::kRotate),
                                          testing::Values(3, 5, 20)));

TEST(LocksFirstAfterAGap, AFilterThatStartsAgainWaitsForItsAgreementAgain) {
  const auto filter = std::make_shared<TurningProbe>(0);
  FastLoop fast(filter, GainPolicy::kPaper, 5, {}, Agreement(salient(), false, kT_s));
  std::int64_t k = 0;
  while (k < 2 * kTurn) fast.tick(at_no_load(k++));
  EXPECT_FALSE(fast.tick(at_no_load(k++)).status & kGainEveryTick);
  k += FastLoop::kMaxGap + 5;
  EXPECT_TRUE(fast.tick(at_no_load(k)).status & kGainEveryTick);
}

}  // namespace
}  // namespace twinrate::test

// The vote of the judging rows on one claim.
#include "trace/vote.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/trace/fitted_drive.hpp"
#include "trace/transfer.hpp"

namespace twinrate {
namespace {

// Without a claim the others are fitted again, which changes equations that it does not act on.
TEST(Vote, AClaimIsJudgedByItsOwnEquations) {
  const FittedDrive drive(simulate_synthetic({.duration_s = 3}), {});
  const Sampled with = drive.chain().whitened(drive.chain().residual({}));
  Sampled without = with;
  without.d *= 1.5, without.torque *= 1.2;
  const JudgedFiles files;
  const JudgingRows judging(drive.chain(), files);
  const auto judged = [&](const char* kind, const char* key) {
    return vote(judging, with, without, {}, *effect_with(kind, {{key, 1.0}}), false, false, 1e-6);
  };
  const Vote friction = judged("coulomb_friction", "torque_Nm"),
             resistance = judged("resistance", "change_Ohm"),
             flux = judged("flux_linkage", "change_Wb");
  EXPECT_TRUE(friction.of_torque && !friction.of_voltage);
  EXPECT_TRUE(!resistance.of_torque && resistance.of_voltage);
  EXPECT_TRUE(flux.of_torque && flux.of_voltage);
  EXPECT_NEAR(friction.judgement.held_out_gain, 1 - 1 / (1.2 * 1.2), 1e-6);
  EXPECT_TRUE(std::isinf(friction.change_over_noise));
}

// A doubt about the torque does not concern a flux that the voltage shows.
TEST(Vote, ADoubtAboutTheTorqueRefusesAClaimThatRestsOnIt) {
  const auto rule = [](double loads, double speeds) {
    const Members claim = {effect_with("flux_linkage", {{"change_Wb", -0.01}})};
    const FittedDrive drive(simulate_synthetic({.psi = SyntheticDrive{}.psi - 0.01,
                                                .duration_s = 3,
                                                .counts = 4096,
                                                .speeds = speeds,
                                                .loads = loads,
                                                .omega_more = 60}),
                            claim);
    const Fitter fitter = drive.fitter();
    Gate gate(fitter, drive.chain(), {});
    gate.set_doubts([] { return std::vector<Gate::Doubt>{{"sign", "", false, true, true}}; });
    const Passed passed = gate(claim);
    return passed.refused.empty() ? "" : passed.refused.front().rule;
  };
  EXPECT_EQ(rule(0, 0.05), "");
  EXPECT_EQ(rule(20, 0.05), "sign");
}

// A gain in one equation does not pay for a loss in the other.
TEST(Vote, AClaimRaisesTheErrorOfNeitherEquation) {
  const FittedDrive drive(simulate_synthetic({.duration_s = 3}), {});
  const Sampled with = drive.chain().whitened(drive.chain().residual({}));
  const JudgedFiles files;
  const JudgingRows judging(drive.chain(), files);
  const auto rule = [&](double voltage, double torque) {
    Sampled without = with;
    without.d *= voltage, without.q *= voltage, without.torque *= torque;
    const Vote v = vote(judging, with, without, {},
                        *effect_with("flux_linkage", {{"change_Wb", 1.0}}), true, false, 1e-6);
    EXPECT_GT(v.judgement.held_out_gain, 0);
    const Refused refused = refused_by_transfer({v}, {}, {}).front();
    return refused.rule + (refused.wrong_kind ? ": " + refused.text : "");
  };
  EXPECT_EQ(rule(1.1, 1.5), "");
  EXPECT_EQ(rule(0.98, 1.5), "transfer: it raises the error of the voltage equation");
  EXPECT_EQ(rule(1.5, 0.98), "transfer: it raises the error of the torque equation");
}

// Noise in a logged voltage hides the controller's response, and raises the energy above that of the
// sensors.
TEST(Vote, WithoutTheControllersResponseAClaimStandsFurtherOutOfTheNoise) {
  Votes votes;
  votes.judgement = {.held_out_gain = 0.3, .p_value = 1e-9, .votes = 20};
  votes.over_noise = 2.9, votes.left_over_noise = 2.3;
  votes.change_over_noise = 250, votes.along_beside_noise = 27;
  const auto rule = [&] { return refused_by_transfer({votes}, {}, {}).front().rule; };
  EXPECT_EQ(rule(), "");
  votes.answer_unknown = true;
  EXPECT_EQ(rule(), "sensors");
  votes.along_beside_noise = 85;
  EXPECT_EQ(rule(), "");
  votes.along_beside_noise = 140, votes.change_over_noise = 37;
  EXPECT_EQ(rule(), "sensors");
  votes.along_beside_noise = 36, votes.change_over_noise = 22e3;
  EXPECT_EQ(rule(), "");
}

TEST(Vote, AVoltageWithoutADrawnResponseHasNone) {
  const FittedDrive drive(simulate_synthetic({.duration_s = 3}), {});
  const Sampled with = drive.chain().whitened(drive.chain().residual({}));
  Sampled without = with;
  without.q *= 1.5;
  const JudgedFiles files;
  const JudgingRows judging(drive.chain(), files);
  const auto unknown = [&] {
    return vote(judging, with, without, {}, *effect_with("resistance", {{"change_Ohm", 1.0}}),
                false, false, 1e-6)
        .answer_unknown;
  };
  without.answer_q = Eigen::VectorXd::Ones(without.q.size());
  EXPECT_FALSE(unknown());
  without.answer_d.setZero(), without.answer_q.setZero();
  EXPECT_TRUE(unknown());
}

}  // namespace
}  // namespace twinrate

// The verdict follows from what passed, what was refused and what structure is left.
#include "trace/verdict.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"
#include "trace/doubts.hpp"
#include "trace/gate.hpp"

namespace twinrate {
namespace {

TraceResult with_refused(const char* rule, bool left) {
  TraceResult r;
  r.refused.push_back(
      {.kind = "torsion", .rule = rule, .left = left, .text = "0.4 of its gain is kept"});
  r.verdict = verdict_of(r);
  return r;
}

// Nothing shows it but the claim that was refused.
TEST(Verdict, ARefusedClaimWithoutAStructureIsNoStatement) {
  const TraceResult r = with_refused("agreement", true);
  EXPECT_EQ(r.verdict, "ambiguous");
  EXPECT_EQ(headline_begins(r),
            "Cannot tell: a claim did not pass the rule of agreement: 0.4 of its "
            "gain is kept. ");
}

TEST(Verdict, ARefusedClaimBesideAStructureIsUnexplained) {
  TraceResult r = with_refused("agreement", true);
  r.structured = true;
  r.unexplained.push_back(
      {.regressor = "i_q", .text = "the residual of the torque depends on i_q"});
  r.verdict = verdict_of(r);
  EXPECT_EQ(r.verdict, "unexplained");
  EXPECT_EQ(headline_begins(r),
            "Unexplained: the residual of the torque depends on i_q, which no effect of the "
            "catalogue was shown to explain; a claim did not pass the rule of "
            "agreement: 0.4 of its gain is kept. ");
}

TEST(Verdict, AClaimRefusedForItsSizeLeavesNoDoubt) {
  EXPECT_EQ(with_refused("size", false).verdict, "nothing_missing");
  EXPECT_EQ(refusal_to_tell(with_refused("size", false)), nullptr);
}

// What explains much of the fitted rows and is not confirmed has no name: a claim may be part of it.
TEST(Verdict, ALargeCandidateThatIsNotConfirmedLeavesADoubt) {
  const auto beside = [](const char* kind, double score_gain) {
    TraceResult r;
    r.verdict = "traced";
    r.sentence = "The model lacks viscous_friction.";
    doubt_unconfirmed({{kind, score_gain, 0, "fails after refinement or on the hold-out"}}, r);
    return r;
  };
  EXPECT_EQ(beside("flux_harmonics", 1461).verdict, "ambiguous");
  EXPECT_EQ(beside("flux_harmonics", 1461).sentence,
            "Cannot tell whether the model lacks more: flux_harmonics would lower the BIC of the "
            "fitted rows by 1461, but its refinement or the held-out rows refused it. The model "
            "lacks viscous_friction.");
  EXPECT_EQ(beside("flux_harmonics", 700).verdict, "traced");
  // The score of a shaft before its fit is a guess.
  EXPECT_EQ(beside("torsion", 5000).verdict, "traced");
}

// The torque alone names a cogging where a flux harmonic explained the voltage, but did not pass.
TEST(Verdict, AClaimRefusedBesideTheVoltageLeavesTheTorqueInDoubt) {
  const auto beside = [](const char* kind, bool left) {
    TraceResult r;
    r.verdict = "traced";
    r.sentence = "The model lacks cogging.";
    doubt_beside_refused(
        {{.kind = kind, .rule = "agreement", .left = left, .text = "0.49 of its gain is kept"}}, r);
    return r;
  };
  const TraceResult doubted = beside("flux_harmonics", true);
  EXPECT_EQ(doubted.verdict, "ambiguous");
  EXPECT_EQ(doubted.sentence,
            "Cannot tell: flux_harmonics can act on voltage and torque; beside the voltage a claim "
            "did not pass the rule of agreement: 0.49 of its gain is kept. The model lacks "
            "cogging.");
  EXPECT_EQ(doubted.refused.size(), 1u);
  EXPECT_EQ(beside("flux_harmonics", false).verdict, "traced");
  EXPECT_EQ(beside("voltage_gain", true).verdict, "traced") << "it makes no torque";
}

// At one speed the rounding of the angle repeats after equal times, like a torque in time. Half of
// 4096 counts make J (2 pi f)^2 pi/4096 = 0.107 Nm at 20 Hz.
TEST(Verdict, ATorqueInTimeAtOneSpeedMayBeTheRoundingOfTheAngle) {
  const auto doubt = [](bool held, double f_Hz, double amplitude_Nm, double i_lsb = 0) {
    RawLog raw = simulate_synthetic({.duration_s = 2, .held = held});
    const double count = kTwoPi / 4096;
    for (double& theta_m : raw.theta_m) theta_m = count * std::floor(theta_m / count);
    const FittedDrive drive(raw, {});
    const auto line =
        effect_with("periodic_torque", {{"frequency_Hz", f_Hz}, {"amplitude_Nm", amplitude_Nm}});
    return doubt_of_line(*line, drive.chain(), i_lsb);
  };
  EXPECT_EQ(doubt(true, 20, 0.1),
            "at constant speed, rounding by half a count and half a step of the currents can make "
            "0.107 Nm at that frequency");
  EXPECT_EQ(doubt(true, 20, 0.11), "");
  EXPECT_NE(doubt(true, 20, 0.11, 0.01), "") << "half of 10 mA makes 5.7 mNm";
  EXPECT_EQ(doubt(true, 10, 0.1), "") << "a quarter of it";
  EXPECT_EQ(doubt(false, 20, 0.1), "") << "the speed varies";
}

// The counts pass faster than the rows are read: their beat with the rows is a line at any size.
TEST(Verdict, ATorqueInTimeAtOneSpeedMayBeTheBeatOfTheCounts) {
  RawLog raw = simulate_synthetic({.duration_s = 2, .held = true, .counts = 4096});
  const std::size_t end = raw.size() - 1, half = end / 2;
  const double turned = raw.theta_m[end] - raw.theta_m[half], T = raw.t[end] - raw.t[half];
  const double counts_Hz = std::abs(turned) / T * 4096 / kTwoPi;
  ASSERT_GT(counts_Hz, 1e4) << "rows a second";
  const FittedDrive drive(raw, {});
  const auto doubt = [&](double f_Hz) {
    const auto line =
        effect_with("periodic_torque", {{"frequency_Hz", f_Hz}, {"amplitude_Nm", 1e5}});
    return doubt_of_line(*line, drive.chain(), 0);
  };
  EXPECT_NE(doubt(counts_Hz - 1e4).find("the counts of the angle pass at"), std::string::npos);
  EXPECT_EQ(doubt(counts_Hz - 1e4 + 5), "");
}

// No model of a cogging of 4 Nm is known to 10 mNm.
TEST(Gate, RefusesAPartWithinTheErrorOfALargerEffect) {
  const auto refused_beside = [](double amplitude_Nm) {
    SyntheticDrive drive{.duration_s = 3};
    drive.extra_load = [=](double, double theta, double) {
      return amplitude_Nm * std::sin(17 * theta + 0.8) + 0.01 * std::sin(theta + 0.4);
    };
    const Members claims = {
        effect_with("cogging",
                    {{"order", 17.}, {"amplitude_Nm", amplitude_Nm}, {"phase_rad", 0.8}}),
        effect_with("eccentric_load", {{"amplitude_Nm", 0.01}, {"phase_rad", 0.4}})};
    const FittedDrive fitted(simulate_synthetic(drive), claims);
    const Fitter fitter = fitted.fitter();
    const Passed passed = Gate(fitter, fitted.chain(), {})(claims);
    return passed.refused.empty() ? ""
                                  : passed.refused.front().kind + ": " + passed.refused[0].rule;
  };
  EXPECT_EQ(refused_beside(0.4), "");
  EXPECT_EQ(refused_beside(4), "eccentric_load: size");
}

}  // namespace
}  // namespace twinrate

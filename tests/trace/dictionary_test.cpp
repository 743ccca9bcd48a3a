// Candidates whose columns are recomputed after a selection.
#include "trace/dictionary.hpp"

#include <gtest/gtest.h>
#include <sched.h>

#include "tests/trace/fitted_drive.hpp"
#include "trace/lines.hpp"
#include "trace/result.hpp"

namespace twinrate::dictionary_test {

class Renewed : public testing::Test {
 protected:
  // The candidates whose columns have changed by more than 1 in 1000.
  std::vector<std::string> beside(const Effects& effects) {
    const std::vector<Candidate> before = dictionary_.sampled;
    dictionary_.renew(drive_.chain(), effects);
    std::vector<std::string> changed;
    for (std::size_t i = 0; i < before.size(); ++i) {
      const Sampled &a = before[i].columns[0], &b = dictionary_.sampled[i].columns[0];
      const double size = a.q.norm() + a.torque.norm();
      const double change = (a.q - b.q).norm() + (a.torque - b.torque).norm();
      if (change > 1e-3 * size) changed.emplace_back(before[i].effect->kind());
    }
    return changed;
  }

 private:
  FittedDrive drive_{simulate_synthetic({.duration_s = 2}), {}};
  Dictionary dictionary_{.sampled = candidates(), .whitened = {}};

  std::vector<Candidate> candidates() const {
    std::vector<Candidate> list;
    for (const auto& effect :
         {effect_with("cogging", {{"order", 41}, {"amplitude_Nm", 0.1}}),
          effect_with("current_gain", {{"gain_a", 0.01}}),
          effect_with("dead_time", {{"dead_time_s", 1e-6}, {"linear_current_A", 0.1}}),
          effect_with("encoder_offset", {{"offset_rad", 0.01}})})
      list.push_back({effect, drive_.chain().columns(*effect)});
    return list;
  }
};

using Names = std::vector<std::string>;

TEST_F(Renewed, NoCandidateChangesBesideALoad) {
  EXPECT_EQ(beside({effect_with("coulomb_friction", {{"torque_Nm", 0.2}})}), Names{});
}

TEST_F(Renewed, ASensorEffectChangesBesideAnInductance) {
  EXPECT_EQ(beside({effect_with("inductance", {{"change_d_H", 2e-3}, {"change_q_H", 2e-3}})}),
            (Names{"current_gain", "encoder_offset"}));
}

TEST_F(Renewed, AnEffectWithAKinkAtZeroChangesBesideACurrentOffset) {
  const Names changed = beside({effect_with("current_offset", {{"offset_a_A", 0.2}})});
  EXPECT_EQ(std::count(changed.begin(), changed.end(), "dead_time"), 1);
  EXPECT_EQ(std::count(changed.begin(), changed.end(), "cogging"), 0);
}

TEST_F(Renewed, AnEffectOfTheAngleChangesBesideALateOrWrongAngle) {
  const auto cogging_changed = [&](const std::shared_ptr<Effect>& effect) {
    const Names changed = beside({effect});
    return std::count(changed.begin(), changed.end(), "cogging") > 0;
  };
  EXPECT_FALSE(cogging_changed(effect_with("encoder_offset", {{"offset_rad", 0.02}})));
  EXPECT_FALSE(cogging_changed(effect_with("encoder_eccentricity", {{"amplitude_rad", 2e-3}})));
  EXPECT_TRUE(cogging_changed(effect_with("encoder_eccentricity", {{"amplitude_rad", 0.02}})));
  EXPECT_TRUE(cogging_changed(effect_with(
      "signal_lag", {{"signal", SamplingFacts::kAngle}, {"form", 0}, {"lag_s", 2e-4}})));
}

// An effect in the model does not need its own column.
TEST_F(Renewed, AnEffectInTheModelIsNotRenewed) {
  const Names changed = beside({effect_with("current_gain", {{"gain_a", 0.03}})});
  EXPECT_EQ(std::count(changed.begin(), changed.end(), "current_gain"), 0);
}

// The drift counts from the start of the record, not of the drive's clock.
TEST(Candidates, DriftWithTheRecordNotWithItsClock) {
  RawLog raw = simulate_synthetic({.duration_s = 2});
  for (double& t : raw.t) t += 3600;
  const FittedDrive drive(raw, {});
  std::size_t drifting = 0;
  for (const Candidate& c : make_candidates(drive.chain())) {
    if (c.effect->kind() != "resistance") continue;
    const bool drifts = get_key(*c.effect, "time_constant_s") > 0;
    EXPECT_NEAR(get_key(*c.effect, "start_s"), drifts ? 3600 : 0, 0.001);
    drifting += drifts;
  }
  EXPECT_EQ(drifting, 5u);
}

// On one CPU and on all: the same columns to the last bit.
TEST(Candidates, DoNotDependOnTheNumberOfCpus) {
  const FittedDrive drive(simulate_synthetic({.duration_s = 1}), {});
  const std::vector<Candidate> on_all = make_candidates(drive.chain());
  cpu_set_t all, one;
  ASSERT_EQ(sched_getaffinity(0, sizeof all, &all), 0);
  CPU_ZERO(&one);
  int first = 0;
  while (!CPU_ISSET(first, &all)) ++first;
  CPU_SET(first, &one);
  ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
  const std::vector<Candidate> on_one = make_candidates(drive.chain());
  ASSERT_EQ(sched_setaffinity(0, sizeof all, &all), 0);
  ASSERT_EQ(on_one.size(), on_all.size());
  for (std::size_t i = 0; i < on_one.size(); ++i) {
    EXPECT_EQ(on_one[i].effect->kind(), on_all[i].effect->kind());
    ASSERT_EQ(on_one[i].columns.size(), on_all[i].columns.size());
    for (std::size_t r = 0; r < on_one[i].columns.size(); ++r) {
      const Sampled &x = on_one[i].columns[r], &y = on_all[i].columns[r];
      EXPECT_TRUE(x.d == y.d && x.q == y.q && x.torque == y.torque && x.noise_d == y.noise_d &&
                  x.noise_torque == y.noise_torque)
          << on_one[i].effect->kind();
    }
  }
}

// Rounding makes the share of its own of either column the smaller.
TEST(NormalEquations, OfTwoColumnsThatAreOneTheLaterIsTheSpuriousOne) {
  constexpr double kShare = 4e-6;  // of its own, of the last two columns beside one another
  const auto equations = [](double rounding) {
    NormalEquations normal{Eigen::MatrixXd::Zero(4, 4), Eigen::VectorXd::Zero(4),
                           Eigen::VectorXd::Zero(4)};
    normal.A.diagonal() << 4, 9, 1, 1;  // the second is 1.5 times the first
    normal.A(0, 1) = normal.A(1, 0) = 6;
    normal.A(2, 3) = normal.A(3, 2) = std::sqrt(1 - kShare);
    for (int c : {2, 3}) {
      normal.A(0, c) = normal.A(c, 0) = 0.2 * (1 + rounding);
      normal.A(1, c) = normal.A(c, 1) = 0.3;
    }
    return normal;
  };
  for (double rounding : {-1e-13, 0.0, 1e-13}) {
    const NormalEquations normal = equations(rounding);
    EXPECT_EQ(normal.spurious({1, 1, 1, 1}), 1);
    EXPECT_EQ(normal.spurious({1, 0, 1, 1}), 3);
    EXPECT_EQ(normal.spurious({1, 0, 1, 0}), -1);
  }
}

// A zone of zero current has no derivative.
TEST(NormalEquations, AColumnWithoutAValueIsLeftOut) {
  NormalEquations normal{Eigen::MatrixXd::Zero(3, 3), Eigen::VectorXd::Zero(3),
                         Eigen::VectorXd::Zero(3)};
  normal.A.diagonal() << 4, 9, NAN;
  normal.A.row(2).setConstant(NAN);
  normal.A.col(2).setConstant(NAN);
  normal.b << 8, 9, NAN;
  const std::vector<char> use = normal.usable(1);
  EXPECT_EQ(use, (std::vector<char>{1, 1, 0}));
  EXPECT_LT((normal.solve(use) - Eigen::Vector3d(2, 1, 0)).norm(), 1e-6);
  EXPECT_TRUE(normal.inverse(use).allFinite());
}

TEST(TracedParameters, DoNotHoldTheClockOfTheLog) {
  const auto effect = effect_with("resistance", {{"change_Ohm", 0.1}, {"start_s", 3600}});
  std::vector<std::string> names;
  for (const TracedParameter& p : traced_parameters(*effect, {})) names.push_back(p.name);
  EXPECT_EQ(names, (Names{"change", "time_constant"}));
}

// The sixth harmonic of the electrical turn and its double, whatever the number of pole pairs.
TEST(Candidates, HoldTheSixthHarmonicOfTheFlux) {
  for (int n_p = 1; n_p <= 12; ++n_p) {
    DriveFacts facts = servo().facts();
    facts.machine.n_p = n_p;
    const auto effect = make_effect("flux_harmonics");
    effect->prepare(facts);
    for (const TracedKey& key : effect->tracing().traced_keys()) {
      if (std::string_view(key.key) != "order") continue;
      EXPECT_EQ(std::count(key.grid.begin(), key.grid.end(), 6.0 * n_p), 1) << n_p;
      EXPECT_EQ(std::count(key.grid.begin(), key.grid.end(), 12.0 * n_p), 1) << n_p;
    }
  }
}

TEST(Lines, AnOrderHasMoreThanTwoSamplesAndTwoCountsAPeriod) {
  const auto highest = [](double speeds, int counts) {
    const FittedDrive drive(
        simulate_synthetic({.duration_s = 2, .counts = counts, .speeds = speeds}), {});
    return highest_order(drive.chain());
  };
  EXPECT_EQ(highest(0.05, 1 << 20), 2000) << "the highest of all";
  EXPECT_NEAR(highest(0.3, 1440), 719.5, 1e-6);
  // Nineteen of twenty rows are faster than 3 rad/s, and the low-pass reaches to 400 Hz.
  const double fast = highest(1, 1 << 20);
  EXPECT_GT(fast, kTwoPi * 400 / 45);
  EXPECT_LT(fast, 2000);
}

}  // namespace twinrate::dictionary_test

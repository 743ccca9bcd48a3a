// The tick path of a running drive does not allocate.
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/loop/closed_loop.hpp"
#include "tests/support/allocation_count.hpp"

namespace twinrate::test {
namespace {

std::int64_t allocations_in_ticks(const std::string& preset, const Overrides& overrides) {
  ClosedLoop loop(load(preset, overrides));
  for (int k = 0; k < 50; ++k) loop.tick();  // warm-up: first use of the solver's memory
  const std::int64_t before = allocation_count();
  for (int k = 0; k < 1000; ++k) loop.tick();
  return allocation_count() - before;
}

TEST(AllocationCount, SeesNewMallocAndEigensAlignedMemory) {
  const std::int64_t start = allocation_count();
  int* volatile by_new = new int(1);  // volatile: clang leaves out a pair of new and delete
  EXPECT_GE(allocation_count() - start, 1);
  delete by_new;
  const std::int64_t before_malloc = allocation_count();
  void* volatile by_malloc = std::malloc(16);
  EXPECT_EQ(allocation_count() - before_malloc, 1);
  std::free(by_malloc);
  const std::int64_t before_eigen = allocation_count();
  Eigen::MatrixXd dynamic(3, 3);
  dynamic.setOnes();
  EXPECT_GE(allocation_count() - before_eigen, 1);
}

TEST(TickPath, DoesNotAllocateWithAnyPredictionOrEngine) {
  for (const char* prediction : {"euler", "rk4", "exact"}) {
    for (const char* engine : {"rk", "erk", "cvode"}) {
      EXPECT_EQ(
          allocations_in_ticks("dilys2021", {fmt::format("estimator.prediction={}", prediction),
                                             fmt::format("plant.engine={}", engine)}),
          0)
          << prediction << ", " << engine;
    }
  }
}

TEST(TickPath, DoesNotAllocateWithTheDisturbanceFilter) {
  for (const char* prediction : {"euler", "rk4", "exact"})
    EXPECT_EQ(
        allocations_in_ticks("laas_mn4004", {fmt::format("estimator.prediction={}", prediction)}),
        0)
        << prediction;
}

TEST(TickPath, DoesNotAllocateWithStateFeedbackOscillatorsOrLearning) {
  for (const char* kind : {"ekf_disturbance", "ekf_harmonic"})
    for (const char* compensation : {"paper", "angle_domain"})
      EXPECT_EQ(allocations_in_ticks("niewiara2020",
                                     {fmt::format("estimator.kind={}", kind), "rates.n=4",
                                      fmt::format("controller.compensation={}", compensation)}),
                0)
          << kind << ", " << compensation;
}

TEST(TickPath, DoesNotAllocateWithTheFiltersOfTheSalientMachine) {
  for (const char* kind : {"backemf_printed", "active_flux", "eemf", "dq_ekf", "ekf_joint"})
    for (const char* prediction : {"euler", "rk4", "exact"})
      EXPECT_EQ(
          allocations_in_ticks("kim-ipmsm", {fmt::format("estimator.kind={}", kind),
                                             fmt::format("estimator.prediction={}", prediction)}),
          0)
          << kind << ", " << prediction;
}

TEST(TickPath, DoesNotAllocateWithAPropagatedGain) {
  for (const char* form : {"joseph", "sequential"})
    EXPECT_EQ(allocations_in_ticks("dilys2021", {"gain.policy=propagated", "rates.n=10",
                                                 fmt::format("estimator.covariance={}", form)}),
              0)
        << form;
}

TEST(TickPath, DoesNotAllocateDuringTheStart) {
  EXPECT_EQ(allocations_in_ticks("dilys2021",
                                 {"start=align_if", "controller.foc.startup.t_align_s=0.02"}),
            0);
}

TEST(TickPath, DoesNotAllocateOnAProfileOrWithEffects) {
  Config config = Config::parse(
      "preset = \"dilys2021\"\n"
      "[reference]\nomega_e_rad_s = [[0, 400], [0.05, 300], [0.1, 400]]\n"
      "[controller.foc]\ncompensate_effects = true\n"
      "[[effect]]\nkind = \"cogging\"\nused_in = \"both\"\norder = 6\namplitude_Nm = 0.001\n"
      "[[effect]]\nkind = \"coulomb_friction\"\nused_in = \"both\"\ntorque_Nm = 0.001\n",
      "drive.toml");
  ClosedLoop loop(std::move(config));
  for (int k = 0; k < 50; ++k) loop.tick();
  const std::int64_t before = allocation_count();
  for (int k = 0; k < 1000; ++k) loop.tick();
  EXPECT_EQ(allocation_count() - before, 0);
}

TEST(TickPath, DoesNotAllocateWithKnownEffectsOnTheFluxAndBehindTheTerminals) {
  Config config = Config::parse(
      "preset = \"niewiara2020\"\n"
      "[[effect]]\nkind = \"saturation\"\nused_in = \"both\"\ncurrent_q_A = 15.0\n"
      "[[effect]]\nkind = \"cross_saturation\"\nused_in = \"both\"\ncoefficient_H_A = 2e-4\n"
      "[[effect]]\nkind = \"phase_asymmetry\"\nused_in = \"both\"\nchange_a_Ohm = 0.1\n"
      "[[effect]]\nkind = \"iron_loss\"\nused_in = \"both\"\nresistance_Ohm = 500.0\n",
      "drive.toml");
  ClosedLoop loop(std::move(config));
  for (int k = 0; k < 50; ++k) loop.tick();
  const std::int64_t before = allocation_count();
  for (int k = 0; k < 300; ++k) loop.tick();
  EXPECT_EQ(allocation_count() - before, 0);
}

TEST(TickPath, DoesNotAllocateWithASwitchedInverterAndEffectsOnItAndOnTheSensors) {
  Config config = Config::parse(
      "preset = \"dilys2021\"\n[plant]\ninverter = \"switched\"\n"
      "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 1e-6\n"
      "[[effect]]\nkind = \"dc_bus_ripple\"\namplitude_V = 0.5\nfrequency_Hz = 300.0\n"
      "[[effect]]\nkind = \"current_offset\"\noffset_a_A = 0.01\noffset_b_A = 0.0\n"
      "[[effect]]\nkind = \"encoder_eccentricity\"\namplitude_rad = 1e-4\n",
      "drive.toml");
  ClosedLoop loop(std::move(config));
  for (int k = 0; k < 50; ++k) loop.tick();
  const std::int64_t before = allocation_count();
  for (int k = 0; k < 300; ++k) loop.tick();
  EXPECT_EQ(allocation_count() - before, 0);
}

}  // namespace
}  // namespace twinrate::test

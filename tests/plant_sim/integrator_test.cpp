#include "plant_sim/integrator.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "model/random.hpp"

namespace twinrate {
namespace {

constexpr double kTs = 2e-4;

MachineParameters dilys() {
  return {.R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
}

PlantState random_state(std::uint64_t i) {
  return {normal(1, 0, i), normal(1, 1, i), 100 * normal(1, 2, i), 10 * normal(1, 3, i)};
}
PlantInput random_input(std::uint64_t i) {
  return {.u_alphabeta = Vec2(6 * normal(1, 4, i), 6 * normal(1, 5, i)),
          .T_load = 0.05 * normal(1, 6, i)};
}

// Largest difference of the currents after one interval.
double worst_current_error(Integrator& a, Integrator& b) {
  double worst = 0;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const PlantState x = random_state(i);
    const PlantState difference =
        a.advance(x, random_input(i), kTs) - b.advance(x, random_input(i), kTs);
    worst = std::max(worst, difference.head<2>().cwiseAbs().maxCoeff());
  }
  return worst;
}

TEST(Erk, OneStepAnIntervalIsWithinTensOfMicroamperesOfTheReferee) {
  const DriveModel model(dilys(), {}, 24);
  const auto erk = make_integrator(Engine::kErk, model, 1);
  const auto cvode = make_integrator(Engine::kCvode, model, 1);
  const double worst = worst_current_error(*erk, *cvode);
  EXPECT_LT(worst, 1e-4);  // voltage steps of 6 V rms, far larger than a drive's
  EXPECT_GT(worst, 1e-8);
}

TEST(Erk, ConvergesWithOrderFive) {
  const DriveModel model(dilys(), {}, 24);
  const auto truth = make_integrator(Engine::kErk, model, 64);
  const auto coarse = make_integrator(Engine::kErk, model, 2);
  const auto fine = make_integrator(Engine::kErk, model, 4);
  const double order =
      std::log2(worst_current_error(*coarse, *truth) / worst_current_error(*fine, *truth));
  EXPECT_NEAR(order, 5, 0.5);
}

// The library stops after 500 steps unless told otherwise.
TEST(Erk, TakesTheMostStepsThatADriveFileMayAskFor) {
  const DriveModel model(dilys(), {}, 24);
  const auto some = make_integrator(Engine::kErk, model, 64);
  const auto most = make_integrator(Engine::kErk, model, 1000);
  EXPECT_LT(worst_current_error(*some, *most), 1e-9);
}

TEST(Cvode, IsWithinItsToleranceOfManySmallSteps) {
  const DriveModel model(dilys(), {}, 24);
  const auto truth = make_integrator(Engine::kErk, model, 64);
  const auto cvode = make_integrator(Engine::kCvode, model, 1);
  const double worst = worst_current_error(*cvode, *truth);
  EXPECT_LT(worst, 1e-6);
  EXPECT_GT(worst, 0);
}

TEST(Integrators, RememberNothingBetweenIntervals) {
  const DriveModel model(dilys(), {}, 24);
  for (Engine engine : {Engine::kRk, Engine::kErk, Engine::kCvode}) {
    const auto used = make_integrator(engine, model, 1), fresh = make_integrator(engine, model, 1);
    for (std::uint64_t i = 0; i < 20; ++i) used->advance(random_state(i), random_input(i), kTs);
    EXPECT_EQ(used->advance(random_state(50), random_input(50), kTs),
              fresh->advance(random_state(50), random_input(50), kTs));
  }
}

TEST(Integrators, FollowTheLockedRotorsExponential) {
  MachineParameters m = dilys();
  m.J = 1e4;
  const DriveModel model(m, {}, 24);
  for (Engine engine : {Engine::kRk, Engine::kErk, Engine::kCvode}) {
    const auto integrator = make_integrator(engine, model, 4);
    PlantState x = PlantState::Zero();
    for (int k = 1; k <= 20; ++k) {
      x = integrator->advance(x, {.u_alphabeta = {3, 0}}, kTs);
      EXPECT_NEAR(x[0], 2.5 * (1 - std::exp(-2400 * kTs * k)), 1e-6);
      EXPECT_NEAR(x[1], 0, 1e-9);
    }
  }
}

TEST(Integrators, ReportAStateThatIsNotFinite) {
  const DriveModel model(dilys(), {}, 24);
  for (Engine engine : {Engine::kRk, Engine::kErk, Engine::kCvode}) {
    const auto integrator = make_integrator(engine, model, 1);
    PlantState x = PlantState::Zero();
    x[0] = std::nan("");
    EXPECT_THROW(integrator->advance(x, {}, kTs), std::runtime_error);
  }
}

}  // namespace
}  // namespace twinrate

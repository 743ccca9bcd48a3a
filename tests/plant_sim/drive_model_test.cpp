#include "plant_sim/drive_model.hpp"

#include <gtest/gtest.h>

#include "model/random.hpp"
#include "plant_sim/integrator.hpp"
#include "tests/support/field_setter.hpp"

namespace twinrate {
namespace {

MachineParameters salient() {
  return {.R_s = 0.8, .L_d = 3e-3, .L_q = 7e-3, .psi_f = 0.12, .J = 2e-4, .B = 4e-4, .n_p = 3};
}

TEST(DriveModel, SteadyStateVoltageHoldsTheOperatingPoint) {
  const MachineParameters m = salient();
  const DriveModel model(m, {}, 24);
  for (std::uint64_t i = 0; i < 50; ++i) {
    const double i_d = normal(1, 0, i), i_q = 3 * normal(1, 1, i), omega_m = 80 * normal(1, 2, i);
    const double theta_m = 10 * normal(1, 3, i), omega_e = 3 * omega_m;
    const Vec2 u_dq(0.8 * i_d - omega_e * 7e-3 * i_q, 0.8 * i_q + omega_e * (3e-3 * i_d + 0.12));
    const double T_em = 4.5 * (0.12 - 4e-3 * i_d) * i_q;
    const PlantInput input{.u_alphabeta = inverse_park(u_dq, 3 * theta_m),
                           .T_load = T_em - 4e-4 * omega_m};
    const PlantState rate = model.rate({i_d, i_q, omega_m, theta_m}, input, 0);
    EXPECT_NEAR(rate[0], 0, 1e-8);
    EXPECT_NEAR(rate[1], 0, 1e-8);
    EXPECT_NEAR(rate[2], 0, 1e-8);
    EXPECT_EQ(rate[3], omega_m);
  }
}

TEST(DriveModel, PositiveLoadSlowsAForwardTurningRotor) {
  const DriveModel model(salient(), {}, 24);
  EXPECT_NEAR(model.rate({0, 0, 10, 0}, {.T_load = 0.05}, 0)[2], (-4e-4 * 10 - 0.05) / 2e-4, 1e-9);
}

TEST(DriveModel, PositiveQCurrentSpeedsItUp) {
  const DriveModel model(salient(), {}, 24);
  EXPECT_NEAR(model.rate({0, 2, 0, 0}, {}, 0)[2], 4.5 * 0.12 * 2 / 2e-4, 1e-8);
}

TEST(DriveModel, VoltageOnTheFluxAxisRaisesTheDCurrentWhereverTheRotorStands) {
  const DriveModel model(salient(), {}, 24);
  for (double theta_m : {0.0, 0.4, 2.0, -3.0}) {
    const PlantState rate =
        model.rate({0, 0, 0, theta_m}, {.u_alphabeta = inverse_park({6, 0}, 3 * theta_m)}, 0);
    EXPECT_NEAR(rate[0], 6 / 3e-3, 1e-9);
    EXPECT_NEAR(rate[1], 0, 1e-9);
  }
}

TEST(DriveModel, EnergyInIsCopperPlusStoredPlusFrictionPlusLoad) {
  const MachineParameters m = salient();
  const DriveModel model(m, {}, 24);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  const auto stored = [&](const PlantState& x) {
    return 0.75 * (m.L_d * x[0] * x[0] + m.L_q * x[1] * x[1]) + 0.5 * m.J * x[2] * x[2];
  };
  PlantState x(0.5, 1, 20, 0.3);
  const double stored_before = stored(x);
  double in = 0, copper = 0, friction = 0, load = 0;
  constexpr double h = 1e-6;
  for (int interval = 0; interval < 100; ++interval) {
    // A new voltage and load every 200 us.
    const auto i = static_cast<std::uint64_t>(interval);
    const PlantInput input{.u_alphabeta = Vec2(20 * normal(5, 0, i), 20 * normal(5, 1, i)),
                           .T_load = 0.2 * normal(5, 2, i)};
    for (int j = 0; j < 200; ++j) {
      const PlantState next = integrator->advance(x, input, h);
      // Simpson over the step: ends and middle.
      const PlantState middle = integrator->advance(x, input, h / 2);
      const auto add = [&](const PlantState& s, double weight) {
        const Vec2 u_dq = park(input.u_alphabeta, m.n_p * s[3]);
        in += weight * 1.5 * u_dq.dot(s.head<2>());
        copper += weight * 1.5 * m.R_s * s.head<2>().squaredNorm();
        friction += weight * m.B * s[2] * s[2];
        load += weight * input.T_load * s[2];
      };
      add(x, h / 6);
      add(middle, 4 * h / 6);
      add(next, h / 6);
      x = next;
    }
  }
  const double out = copper + friction + load + stored(x) - stored_before;
  EXPECT_NEAR(in, out, 1e-9 * copper);
  // Every term takes part: none of them may hide in the tolerance.
  for (double term : {in, copper, friction, load, stored(x) - stored_before})
    EXPECT_GT(std::abs(term), 1e-5 * copper);
}

TEST(DriveModel, EffectsAddToTheLoadWithTheirSigns) {
  const auto coulomb = make_effect("coulomb_friction");
  test::FieldSetter set({{"torque_Nm", 0.03}});
  coulomb->fields(set);
  const DriveModel plain(salient(), {}, 24), rubbing(salient(), {coulomb}, 24);
  const PlantState forward(0, 0, 50, 0), backward(0, 0, -50, 0);
  EXPECT_NEAR(rubbing.rate(forward, {}, 0)[2] - plain.rate(forward, {}, 0)[2], -0.03 / 2e-4, 1e-8);
  EXPECT_NEAR(rubbing.rate(backward, {}, 0)[2] - plain.rate(backward, {}, 0)[2], 0.03 / 2e-4, 1e-8);
  EXPECT_NEAR(rubbing.total_load(forward, {.T_load = 0.1}, 0), 0.13, 1e-12);
}

TEST(DriveModel, CoggingTurnsTheRotorToTheNextRestPosition) {
  const auto cogging = make_effect("cogging");
  test::FieldSetter set({{"order", 6}, {"amplitude_Nm", 0.02}});
  cogging->fields(set);
  const DriveModel model(salient(), {cogging}, 24);
  // T_load = A sin(6 theta): angle 0 attracts from either side.
  EXPECT_LT(model.rate({0, 0, 0, 0.1}, {}, 0)[2], 0);
  EXPECT_GT(model.rate({0, 0, 0, -0.1}, {}, 0)[2], 0);
}

}  // namespace
}  // namespace twinrate

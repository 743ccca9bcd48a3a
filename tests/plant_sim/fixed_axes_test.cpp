#include "plant_sim/fixed_axes.hpp"

#include <gtest/gtest.h>

#include "model/random.hpp"
#include "plant_sim/integrator.hpp"
#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::fixed_axes_test {
namespace {

MachineParameters salient() {
  return {.R_s = 11, .L_d = 0.05635, .L_q = 0.133, .psi_f = 0.285, .J = 1e-4, .B = 2e-4, .n_p = 2};
}

// (1) of the paper in its axes, q^s along phase a and d^s along -beta, solved for the currents.
Vec2 currents_rate_as_printed(const MachineParameters& m, const Vec2& i_alphabeta,
                              const Vec2& u_alphabeta, double omega_e, double theta_e) {
  const double i_q = i_alphabeta[0], i_d = -i_alphabeta[1];
  const double u_q = u_alphabeta[0], u_d = -u_alphabeta[1], theta_r = theta_e + kPi / 2;
  const double E_q = m.psi_f * omega_e * std::cos(theta_r);
  const double E_d = -m.psi_f * omega_e * std::sin(theta_r);
  return {(u_q - m.R_s * i_q - E_q) / m.L_q, -(u_d - m.R_s * i_d - E_d) / m.L_d};
}

TEST(FixedAxes, CurrentsMoveAsTheirEquationInTheStatorSays) {
  const MachineParameters m = salient();
  const DriveModel model(m, {}, 311, Saliency::kFixedAxes);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  for (std::uint64_t i = 0; i < 20; ++i) {
    const double theta_m = 3 * normal(3, 0, i), omega_m = 100 * normal(3, 1, i);
    const Vec2 i_dq(normal(3, 2, i), normal(3, 3, i));
    const PlantInput input{.u_alphabeta = {80 * normal(3, 4, i), 80 * normal(3, 5, i)}};
    constexpr double h = 1e-7;
    const PlantState x(i_dq[0], i_dq[1], omega_m, theta_m);
    const PlantState next = integrator->advance(x, input, h);
    const Vec2 before = inverse_park(i_dq, 2 * theta_m);
    const Vec2 after = inverse_park(next.head<2>(), 2 * next[3]);
    const Vec2 expected =
        currents_rate_as_printed(m, before, input.u_alphabeta, 2 * omega_m, 2 * theta_m);
    EXPECT_LT(((after - before) / h - expected).norm(), 1e-3 * (1 + expected.norm())) << i;
  }
}

TEST(FixedAxes, TorqueIsThePowerIntoTheEmf) {
  const MachineParameters m = salient();
  const DriveModel model(m, {}, 311, Saliency::kFixedAxes);
  const double omega_m = 90, theta_e = 0.7;
  const Vec2 i_dq(-1, 2), i_alphabeta = inverse_park(i_dq, theta_e);
  const Vec2 emf = 2 * omega_m * m.psi_f * Vec2(-std::sin(theta_e), std::cos(theta_e));
  EXPECT_NEAR(model.torque(i_dq) * omega_m, 1.5 * emf.dot(i_alphabeta), 1e-9);
  EXPECT_GT(DriveModel(m, {}, 311).torque(i_dq), 1.2 * model.torque(i_dq));  // no reluctance torque
}

TEST(FixedAxes, IsTheSameMachineWhereNothingIsSalient) {
  MachineParameters m = salient();
  m.L_q = m.L_d;
  const DriveModel fixed(m, {}, 311, Saliency::kFixedAxes), rotor(m, {}, 311);
  const PlantState x(-0.4, 1.3, 120, 2.2);
  const PlantInput input{.u_alphabeta = {30, -70}, .T_load = 0.4};
  EXPECT_LT((fixed.rate(x, input, 0) - rotor.rate(x, input, 0)).norm(), 1e-8);
}

TEST(FixedAxes, IsWhatThePlantSimulatesOnlyWhereItIsAskedFor) {
  const auto torque_after_a_step = [](const char* saliency) {
    Plant plant =
        test::plant_of(test::load("dilys2021", {"machine.L_q_H=1e-3", "plant.theta_e_start_rad=1.0",
                                                fmt::format("plant.saliency={}", saliency)}));
    for (int k = 0; k < 10; ++k) {
      plant.take_command({.k = k, .u_alphabeta_ref = {1, 3}});
      plant.advance();
    }
    return plant.truth().T_em;
  };
  EXPECT_GT(std::abs(torque_after_a_step("rotor") - torque_after_a_step("fixed_axes")), 1e-3);
}

}  // namespace
}  // namespace twinrate::fixed_axes_test

// An elastic shaft in the plant, and the same shaft simulated along a record.
#include <gtest/gtest.h>

#include "model/effects/memory.hpp"
#include "model/random.hpp"
#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/effects.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::two_masses_test {
namespace {

constexpr double kTs = 1e-4;
constexpr double kJ = 8.8e-3, kJLoad = 2.8e-3;

// Without magnets: the shaft alone.
MachineParameters without_torque() {
  return {.R_s = 1.05, .L_d = 0.0127, .L_q = 0.0127, .psi_f = 1e-9, .J = kJ, .B = 0, .n_p = 3};
}

Effects torsion(double stiffness, double damping) {
  return {test::effect_of(
      "torsion",
      {{"J_load_kgm2", kJLoad}, {"stiffness_Nm_rad", stiffness}, {"damping_Nms_rad", damping}})};
}
Effects backlash(double gap, double stiffness, double damping) {
  return {test::effect_of("backlash", {{"J_load_kgm2", kJLoad},
                                       {"gap_rad", gap},
                                       {"stiffness_Nm_rad", stiffness},
                                       {"damping_Nms_rad", damping}})};
}

TwoMassState state(double omega_m, double delta, double omega_load) {
  TwoMassState x;
  x << 0, 0, omega_m, 0, delta, omega_load;
  return x;
}

double kinetic_and_twist_energy(const TwoMassState& x, double stiffness) {
  return 0.5 * ((kJ - kJLoad) * x[2] * x[2] + kJLoad * x[5] * x[5] + stiffness * x[4] * x[4]);
}

TEST(TwoMasses, SwingFreelyAtTheFrequencyOfBothInertias) {
  const DriveModel model(without_torque(), torsion(61.8, 0), 235);
  const double omega = std::sqrt(61.8 * (1 / (kJ - kJLoad) + 1 / kJLoad));
  for (Engine engine : {Engine::kRk, Engine::kErk, Engine::kCvode}) {
    const auto integrator = make_integrator(engine, model, 1);
    TwoMassState x = state(3, 0.01, 3);
    for (int k = 1; k <= 2000; ++k) {
      x = integrator->advance_two_masses(x, {}, kTs);
      ASSERT_NEAR(x[4], 0.01 * std::cos(omega * k * kTs), 2e-6) << k;
      // No torque from outside: the sum of the momenta stays.
      ASSERT_NEAR((kJ - kJLoad) * x[2] + kJLoad * x[5], kJ * 3, 1e-6);
    }
  }
}

TEST(TwoMasses, KeepTheirEnergyWithoutDampingAndLoseWhatTheDampingTakes) {
  for (double D : {0.0, 0.03}) {
    const DriveModel model(without_torque(), torsion(61.8, D), 235);
    const auto integrator = make_integrator(Engine::kErk, model, 1);
    TwoMassState x = state(3, 0.01, 2);
    const double before = kinetic_and_twist_energy(x, 61.8);
    double lost = 0;
    for (int k = 0; k < 1000; ++k) {
      const TwoMassState middle = integrator->advance_two_masses(x, {}, kTs / 2);
      const TwoMassState next = integrator->advance_two_masses(x, {}, kTs);
      const auto power = [&](const TwoMassState& s) { return D * std::pow(s[2] - s[5], 2); };
      lost += kTs / 6 * (power(x) + 4 * power(middle) + power(next));
      x = next;
    }
    EXPECT_NEAR(kinetic_and_twist_energy(x, 61.8) + lost, before, 1e-9 * before);
    if (D > 0) {
      EXPECT_GT(lost, 0.01 * before);
    }
  }
}

TEST(TwoMasses, TheLoadPullsAtTheLoadAndTheShaftAtTheMotor) {
  const DriveModel model(without_torque(), torsion(61.8, 0.03), 235);
  const TwoMassState rate = model.two_mass_rate(state(5, 0.01, 4), {.T_load = 0.5}, 0);
  const double T_shaft = 61.8 * 0.01 + 0.03 * 1;
  EXPECT_NEAR(rate[2], -T_shaft / (kJ - kJLoad), 1e-9);
  EXPECT_NEAR(rate[4], 1, 1e-12);
  EXPECT_NEAR(rate[5], (T_shaft - 0.5) / kJLoad, 1e-9);
}

TEST(TwoMasses, AnUndeclaredLoadActsWhereTheDeclaredOneDoesAndFrictionAtTheMotor) {
  const TwoMassState x = state(5, 0.01, 4);
  const auto rate_with = [&](const std::shared_ptr<Effect>& effect, const PlantInput& input) {
    Effects effects = torsion(61.8, 0.03);
    if (effect) effects.push_back(effect);
    return DriveModel(without_torque(), effects, 235).two_mass_rate(x, input, 0);
  };
  const TwoMassState declared = rate_with(nullptr, {.t_k = 2, .T_load = 0.5});
  const auto constant = test::effect_of("constant_load", {{"torque_Nm", 0.5}});
  const auto step = test::effect_of("load_step", {{"torque_Nm", 0.5}, {"time_s", 1.0}});
  EXPECT_EQ(rate_with(constant, {.t_k = 2}), declared);
  EXPECT_EQ(rate_with(step, {.t_k = 2}), declared);
  EXPECT_EQ(rate_with(step, {.t_k = 0.5}), rate_with(nullptr, {.t_k = 0.5}));
  const auto friction = test::effect_of("coulomb_friction", {{"torque_Nm", 0.5}});
  const TwoMassState rubbing = rate_with(friction, {.t_k = 2}), free = rate_with(nullptr, {});
  EXPECT_NEAR(rubbing[2], free[2] - 0.5 / (kJ - kJLoad), 1e-6);
  EXPECT_EQ(rubbing[5], free[5]);
}

TEST(TwoMasses, StandWithTheTwistOfTheUndeclaredLoadToo) {
  Effects effects = torsion(61.8, 0.03);
  effects.push_back(test::effect_of("constant_load", {{"torque_Nm", 0.5}}));
  const DriveModel model(without_torque(), effects, 235);
  EXPECT_NEAR(model.shaft_at_rest(0, 0, 0.3).delta, 0.8 / 61.8, 1e-12);
}

// Behind a gap the load rests on the flank that carries it; in the middle where there is none.
TEST(TwoMasses, StandOnTheFlankThatHoldsTheLoad) {
  const DriveModel model(without_torque(), backlash(0.02, 200, 0.05), 235);
  for (double T_load : {0.4, -0.4}) {
    const ShaftState start = model.shaft_at_rest(0, 3, T_load);
    EXPECT_NEAR(start.delta, std::copysign(0.01, T_load) + T_load / 200, 1e-12);
    EXPECT_EQ(start.omega_load, 3);
    const TwoMassState rate = model.two_mass_rate(state(3, start.delta, 3), {.T_load = T_load}, 0);
    EXPECT_NEAR(rate[5], 0, 1e-9) << "the shaft holds the load";
  }
  EXPECT_EQ(model.shaft_at_rest(0, 3, 0).delta, 0);
}

TEST(TwoMasses, OnAStiffShaftAreOne) {
  MachineParameters m = without_torque();
  m.psi_f = 0.2533;
  m.B = 0.003;
  const DriveModel rigid(m, {}, 235), elastic(m, torsion(2e4, 2), 235);
  const auto one = make_integrator(Engine::kErk, rigid, 4);
  const auto two = make_integrator(Engine::kErk, elastic, 4);
  PlantState x(0, 1, 0, 0);
  TwoMassState both = TwoMassState::Zero();
  both[1] = 1;
  both[4] = 0.5 / 2e4;
  for (int k = 0; k < 500; ++k) {
    const PlantInput input{.u_alphabeta = inverse_park({0, 8}, 3 * x[3]), .T_load = 0.5};
    x = one->advance(x, input, kTs);
    both = two->advance_two_masses(both, input, kTs);
  }
  EXPECT_GT(x[2], 1);
  EXPECT_NEAR(both[2], x[2], 5e-3 * x[2]);
  EXPECT_NEAR(both[5], x[2], 5e-3 * x[2]);
}

TEST(TwoMasses, ErkAndCvodeAgreeOnAShaftAndAboutAGap) {
  for (const Effects& effects : {torsion(61.8, 0.03), backlash(0.01, 200, 0.05)}) {
    MachineParameters m = without_torque();
    m.psi_f = 0.2533;
    const DriveModel model(m, effects, 235);
    const auto erk = make_integrator(Engine::kErk, model, 4);
    const auto cvode = make_integrator(Engine::kCvode, model, 1);
    TwoMassState a = TwoMassState::Zero(), b = a;
    for (std::uint64_t k = 0; k < 1000; ++k) {
      const PlantInput input{.u_alphabeta = Vec2(0, 20 * std::sin(0.02 * static_cast<double>(k))),
                             .T_load = 0.1};
      a = erk->advance_two_masses(a, input, kTs);
      b = cvode->advance_two_masses(b, input, kTs);
    }
    EXPECT_NEAR((a - b).norm(), 0, 2e-3 * b.norm());  // a flank met inside a step
    EXPECT_GT(std::abs(b[4]), 1e-4);
  }
}

TEST(Backlash, TheLoadCoastsInsideTheGapAndIsTakenAlongBeyondIt) {
  const DriveModel model(without_torque(), backlash(0.02, 200, 0.05), 235);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  // The motor turns at 2 rad/s, the load is at rest in mid-gap: 5 ms to the flank.
  TwoMassState x = state(2, 0, 0);
  for (int k = 0; k < 49; ++k) x = integrator->advance_two_masses(x, {}, kTs);
  EXPECT_EQ(x[5], 0);
  EXPECT_EQ(x[2], 2);
  for (int k = 0; k < 30; ++k) x = integrator->advance_two_masses(x, {}, kTs);
  EXPECT_GT(x[5], 0.5);
  EXPECT_LT(x[2], 2);
  EXPECT_NEAR((kJ - kJLoad) * x[2] + kJLoad * x[5], (kJ - kJLoad) * 2, 1e-9);
}

TEST(Backlash, AFlankPushesAndNeverPulls) {
  const ShaftFacts gap{.J_load = kJLoad, .stiffness = 200, .damping = 0.5, .gap = 0.02};
  EXPECT_NEAR(shaft_torque(gap, 0.011, 0), 0.2, 1e-12);
  EXPECT_NEAR(shaft_torque(gap, 0.011, 0.2), 0.3, 1e-12);
  EXPECT_EQ(shaft_torque(gap, 0.011, -1), 0);
  EXPECT_NEAR(shaft_torque(gap, -0.011, 0), -0.2, 1e-12);
  EXPECT_EQ(shaft_torque(gap, -0.011, 1), 0);
  EXPECT_EQ(shaft_torque(gap, 0.0099, 5), 0);
}

// Torque residual of the rigid machine along a run of the plant, rms, without and with the
// projection of the shaft. Steps of voltage and load.
struct Residual {
  double rigid = 0, with_shaft = 0;
};
Residual residual_of(const Effects& effects) {
  MachineParameters m = without_torque();
  m.psi_f = 0.2533;
  m.B = 0.003;
  const DriveModel model(m, effects, 235);
  const auto integrator = make_integrator(Engine::kCvode, model, 1);
  const ShaftState start = model.shaft_at_rest(0, 0, 0.3);
  TwoMassState x = state(0, start.delta, start.omega_load);
  std::vector<OperatingPoint> points;
  for (std::uint64_t k = 0; k < 8000; ++k) {
    const double u_q = 12 * normal(1, 0, k / 300) + 0.76 * x[2];
    const double T_load = k / 1500 % 2 ? 1.2 : 0.3;
    points.push_back({.t = kTs * static_cast<double>(k),
                      .i_dq = x.head<2>(),
                      .omega_m = x[2],
                      .theta_m = x[3],
                      .theta_e = 3 * x[3],
                      .T_load = T_load});
    x = integrator->advance_two_masses(
        x,
        {.t_k = points.back().t, .u_alphabeta = inverse_park({0, u_q}, 3 * x[3]), .T_load = T_load},
        kTs);
  }
  ShaftFacts shaft;
  effects[0]->describe_shaft(shaft);
  std::vector<double> T_load(points.size());
  along_shaft(shaft, points, load_behind_shaft(effects, points), kTs, 1, T_load);
  Residual rms;
  for (std::size_t k = 1; k + 1 < points.size(); ++k) {
    const double omega_m_rate = (points[k + 1].omega_m - points[k - 1].omega_m) / (2 * kTs);
    const double rigid = m.torque(points[k].i_dq[0], points[k].i_dq[1]) - m.B * points[k].omega_m -
                         points[k].T_load - m.J * omega_m_rate;
    double left = rigid - T_load[k] + shaft.J_load * omega_m_rate;
    for (const auto& effect : effects) left -= effect->at(points[k]).T_load;
    rms.rigid += rigid * rigid;
    rms.with_shaft += left * left;
  }
  const double count = static_cast<double>(points.size());
  return {std::sqrt(rms.rigid / count), std::sqrt(rms.with_shaft / count)};
}

TEST(Along, ATorsionExplainsWhatTheRigidMachineCannot) {
  const Residual rms = residual_of(torsion(61.8, 0.0317));
  EXPECT_GT(rms.rigid, 0.05);
  EXPECT_LT(rms.with_shaft, 0.02 * rms.rigid);
}

TEST(Along, ABacklashExplainsWhatTheRigidMachineCannot) {
  for (double gap : {0.004, 0.03}) {
    const Residual rms = residual_of(backlash(gap, 300, 0.4));
    EXPECT_GT(rms.rigid, 0.05) << gap;
    EXPECT_LT(rms.with_shaft, 0.1 * rms.rigid) << gap;
  }
}

TEST(Along, ALoadThatNobodyDeclaredGoesThroughTheShaft) {
  for (const Effects& of_shaft : {torsion(61.8, 0.0317), backlash(0.01, 300, 0.4)}) {
    Effects effects = of_shaft;
    effects.push_back(test::effect_of("load_step", {{"torque_Nm", 0.8}, {"time_s", 0.4}}));
    const Residual rms = residual_of(effects);
    EXPECT_GT(rms.rigid, 0.3);
    EXPECT_LT(rms.with_shaft, 0.03 * rms.rigid);
  }
}

TEST(Along, AWrappedAngleIsAsGoodAsAnUnwrapped) {
  const auto effect = torsion(61.8, 0.03)[0];
  std::vector<OperatingPoint> points;
  for (int k = 0; k < 1000; ++k)
    points.push_back({.theta_m = 20 * kTs * k + 0.02 * std::sin(0.015 * k), .T_load = 0.2});
  std::vector<Contribution> unwrapped(points.size()), wrapped(points.size());
  contributions(*effect, points, kTs, unwrapped);
  for (OperatingPoint& p : points) p.theta_m = wrap_turn(p.theta_m);
  contributions(*effect, points, kTs, wrapped);
  double size = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    EXPECT_NEAR(wrapped[k].T_load, unwrapped[k].T_load, 1e-8);
    size = std::max(size, std::abs(unwrapped[k].T_load));
  }
  EXPECT_GT(size, 0.1);
}

TEST(Plant, WithAShaftStandsStillUnderTheLoadThatItHolds) {
  // No torque, no friction: the load falls, motor and load together, as one mass would.
  Plant plant = test::plant_of(
      Config::parse("preset = \"dilys2021\"\n[machine]\npsi_f_Wb = 1e-6\nB_Nms = 0.0\n"
                    "J_kgm2 = 1e-3\n[load]\nT_load_Nm = 0.005\nslew_Nm_s = 0.0\n"
                    "[[effect]]\nkind = \"torsion\"\nJ_load_kgm2 = 4e-4\n"
                    "stiffness_Nm_rad = 20.0\ndamping_Nms_rad = 0.02\n",
                    "d"));
  for (int k = 0; k < 1000; ++k) {
    plant.take_command({.k = k});
    plant.advance();
  }
  EXPECT_NEAR(plant.truth().omega_m, -0.005 / 1e-3 * 0.2, 2e-2);
  EXPECT_NEAR(plant.truth().T_load, 0.005, 1e-12);
}

}  // namespace
}  // namespace twinrate::two_masses_test

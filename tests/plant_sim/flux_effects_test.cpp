// Flux effects in the plant against a machine with changed parameters, in steady state and by
// energy. Iron loss by its power.
#include <gtest/gtest.h>

#include <array>

#include "core/config.hpp"
#include "model/random.hpp"
#include "plant_sim/integrator.hpp"
#include "tests/support/effects.hpp"

namespace twinrate::flux_effects_test {
namespace {

MachineParameters salient() {
  return {.R_s = 0.8, .L_d = 3e-3, .L_q = 7e-3, .psi_f = 0.12, .J = 2e-4, .B = 4e-4, .n_p = 3};
}
DriveFacts facts() {
  return {.machine = salient(), .v_dc = 100, .f_pwm = 1e4};
}
std::shared_ptr<Effect> effect_of(const char* kind, std::map<std::string, double> values) {
  return test::effect_of(kind, std::move(values), facts());
}

struct Pair {
  const char* kind;
  std::map<std::string, double> values;
  void (*change)(MachineParameters&);
};

// A machine with an effect equals a machine with the changed parameter.
TEST(FluxEffects, EqualAMachineWithTheChangedParameter) {
  const Pair pairs[] = {
      {"flux_linkage", {{"change_Wb", -0.01}}, [](MachineParameters& m) { m.psi_f -= 0.01; }},
      {"inductance",
       {{"change_d_H", 4e-4}, {"change_q_H", -1e-3}},
       [](MachineParameters& m) { m.L_d += 4e-4, m.L_q -= 1e-3; }},
      {"resistance", {{"change_Ohm", 0.2}}, [](MachineParameters& m) { m.R_s += 0.2; }}};
  for (const Pair& pair : pairs) {
    MachineParameters changed = salient();
    pair.change(changed);
    const DriveModel with(salient(), {effect_of(pair.kind, pair.values)}, 100);
    const DriveModel other(changed, {}, 100), without(salient(), {}, 100);
    double moved = 0;
    for (std::uint64_t i = 0; i < 50; ++i) {
      const PlantState x(normal(1, 0, i), 3 * normal(1, 1, i), 80 * normal(1, 2, i),
                         10 * normal(1, 3, i));
      const PlantInput input{.u_alphabeta = Vec2(20 * normal(1, 4, i), 20 * normal(1, 5, i)),
                             .T_load = 0.1};
      const PlantState rate = with.rate(x, input, 0), expected = other.rate(x, input, 0);
      EXPECT_NEAR((rate - expected).norm(), 0, 1e-8 * expected.norm()) << pair.kind;
      EXPECT_NEAR(with.torque(x.head<2>()), other.torque(x.head<2>()), 1e-12) << pair.kind;
      moved = std::max(moved, (without.rate(x, input, 0) - expected).norm() / expected.norm());
    }
    EXPECT_GT(moved, 0.02) << pair.kind;
  }
}

TEST(FluxEffects, SteadyStateVoltageHoldsTheOperatingPointOfASaturatedMachine) {
  const DriveModel model(salient(), {effect_of("saturation", {{"current_q_A", 6}})}, 100);
  for (const double i_q : {-4.0, 2.0, 5.0}) {
    const double i_d = -1, omega_m = 60, omega_e = 180;
    const double psi_d = 3e-3 * i_d + 0.12, psi_q = 7e-3 * i_q / (1 + std::abs(i_q) / 6);
    const Vec2 u_dq(0.8 * i_d - omega_e * psi_q, 0.8 * i_q + omega_e * psi_d);
    const double T_em = 4.5 * (psi_d * i_q - psi_q * i_d);
    const PlantState rate =
        model.rate({i_d, i_q, omega_m, 0.3},
                   {.u_alphabeta = inverse_park(u_dq, 0.9), .T_load = T_em - 4e-4 * omega_m}, 0);
    EXPECT_NEAR(rate.head<3>().norm(), 0, 1e-7);
    EXPECT_NEAR(model.torque({i_d, i_q}), T_em, 1e-12);
  }
}

TEST(FluxEffects, ALittleVoltageMovesASaturatedAxisFaster) {
  const DriveModel model(salient(), {effect_of("saturation", {{"current_q_A", 6}})}, 100);
  // Standstill, 3 A along q held by R_s i, and a volt more: 1/(L_q/(1 + x)^2) with x = 0.5.
  const PlantState rate = model.rate({0, 3, 0, 0}, {.u_alphabeta = Vec2(0, 0.8 * 3 + 1)}, 0);
  EXPECT_NEAR(rate[1], 1 / (7e-3 / (1.5 * 1.5)), 1e-4);
}

// Stored energy: 3/2 (i psi - integral of psi along the path to i), without a closed form.
double field_energy(const MachineParameters& m, const Effects& effects, const Vec2& i_dq) {
  const auto flux = [&](double share) {
    const Vec2 i = share * i_dq;
    return Vec2(Vec2(m.L_d * i[0], m.L_q * i[1]) + sum_at(effects, {.i_dq = i}).psi_dq);
  };
  // Gauss-Legendre, five points.
  constexpr std::array<double, 3> kNode = {0, 0.5384693101056831, 0.906179845938664};
  constexpr std::array<double, 3> kWeight = {0.5688888888888889, 0.4786286704993665,
                                             0.2369268850561891};
  double coenergy = kWeight[0] * 0.5 * flux(0.5).dot(i_dq);
  for (std::size_t n = 1; n < 3; ++n)
    coenergy +=
        kWeight[n] * 0.5 * (flux(0.5 * (1 - kNode[n])) + flux(0.5 * (1 + kNode[n]))).dot(i_dq);
  return 1.5 * (flux(1).dot(i_dq) - coenergy);
}

TEST(FluxEffects, EnergyInIsCopperStoredFrictionAndLoad) {
  const MachineParameters m = salient();
  const Effects effects{effect_of("saturation", {{"current_q_A", 8}, {"current_d_A", 12}}),
                        effect_of("cross_saturation", {{"coefficient_H_A", 2e-4}})};
  const DriveModel model(m, effects, 100);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  const auto stored = [&](const PlantState& x) {
    return field_energy(m, effects, x.head<2>()) + 0.5 * m.J * x[2] * x[2];
  };
  PlantState x(0.5, 1, 20, 0.3);
  const double stored_before = stored(x);
  double in = 0, copper = 0, friction = 0, load = 0, cross_work = 0;
  constexpr double h = 2e-6;
  for (int interval = 0; interval < 40; ++interval) {
    const double phase = 0.7 * interval;
    const PlantInput input{.u_alphabeta = Vec2(20 * std::sin(phase), 20 * std::cos(1.3 * phase)),
                           .T_load = 0.2 * std::sin(0.2 * phase)};
    for (int j = 0; j < 100; ++j) {
      const PlantState middle = integrator->advance(x, input, h / 2);
      const PlantState next = integrator->advance(x, input, h);
      const auto add = [&](const PlantState& s, double weight) {
        in += weight * 1.5 * park(input.u_alphabeta, 3 * s[3]).dot(s.head<2>());
        copper += weight * 1.5 * m.R_s * s.head<2>().squaredNorm();
        friction += weight * m.B * s[2] * s[2];
        load += weight * input.T_load * s[2];
        const Vec2 i_dq = s.head<2>(), psi = effects[1]->at({.i_dq = i_dq}).psi_dq;
        cross_work += weight * std::abs(4.5 * (psi[0] * i_dq[1] - psi[1] * i_dq[0]) * s[2]);
      };
      add(x, h / 6), add(middle, 4 * h / 6), add(next, h / 6);
      x = next;
    }
  }
  const double out = copper + friction + load + stored(x) - stored_before;
  EXPECT_NEAR(in, out, 2e-6 * in);
  for (const double term : {copper, friction, load, cross_work})
    EXPECT_GT(std::abs(term), 2e-4 * in);
}

TEST(IronLoss, TakesFromTheTerminalsCopperLossItsOwnLossAndTheShaftsPower) {
  const MachineParameters m = salient();
  constexpr double kRc = 40;
  const auto effect = effect_of("iron_loss", {{"resistance_Ohm", kRc}});
  const DriveModel model(m, {effect}, 100);
  const double i_d = -1, i_q = 3, omega_m = 60, omega_e = 180, theta_e = 0.9;
  const Vec2 psi(0.12 + 3e-3 * i_d, 7e-3 * i_q);
  const Vec2 emf = omega_e * Vec2(-psi[1], psi[0]);
  const Vec2 i_terminal = Vec2(i_d, i_q) + emf / kRc;
  const Vec2 u_dq = m.R_s * i_terminal + emf;
  const PlantInput input{.u_alphabeta = inverse_park(u_dq, theta_e)};
  const PlantState x(i_d, i_q, omega_m, theta_e / 3);
  EXPECT_NEAR(model.rate(x, input, 0).head<2>().norm(), 0, 1e-9);
  const Vec2 i_read = Vec2(i_d, i_q) + park(clarke(model.sensing_at(x, input, 0).i_abc), theta_e);
  EXPECT_NEAR((i_read - i_terminal).norm(), 0, 1e-12);
  const double in = 1.5 * u_dq.dot(i_read);
  const double copper = 1.5 * m.R_s * i_read.squaredNorm();
  const double iron = 1.5 * kRc * (i_read - Vec2(i_d, i_q)).squaredNorm();
  EXPECT_NEAR(in, copper + iron + model.torque({i_d, i_q}) * omega_m, 1e-10 * in);
  EXPECT_GT(iron, 0.05 * in);
}

TEST(IronLoss, ItsCurrentPassesTheResistancesTheInverterAndTheSensorsAtTheTerminals) {
  const MachineParameters m = salient();
  constexpr double kRc = 40;
  const Effects effects = {
      effect_of("iron_loss", {{"resistance_Ohm", kRc}}),
      effect_of("resistance", {{"change_Ohm", 0.3}}),
      effect_of("phase_asymmetry",
                {{"change_a_Ohm", 0.2}, {"change_b_Ohm", 0.2}, {"change_c_Ohm", 0.2}}),
      effect_of("inverter_drop", {{"threshold_V", 0}, {"resistance_Ohm", 0.05}}),
      effect_of("current_gain", {{"gain_a", 0.02}, {"gain_b", 0.02}, {"gain_c", 0.02}})};
  const DriveModel model(m, effects, 100);
  const double i_d = -1, i_q = 3, omega_m = 60, theta_e = 0.9;
  const Vec2 emf = 180 * Vec2(-7e-3 * i_q, 0.12 + 3e-3 * i_d);
  const Vec2 i_terminal = Vec2(i_d, i_q) + emf / kRc;
  const Vec2 u_dq = (m.R_s + 0.3 + 0.2 + 0.05) * i_terminal + emf;
  const PlantInput input{.u_alphabeta = inverse_park(u_dq, theta_e)};
  const PlantState x(i_d, i_q, omega_m, theta_e / 3);
  EXPECT_NEAR(model.rate(x, input, 0).head<2>().norm(), 0, 1e-9);
  const Vec2 i_read = Vec2(i_d, i_q) + park(clarke(model.sensing_at(x, input, 0).i_abc), theta_e);
  EXPECT_NEAR((i_read - 1.02 * i_terminal).norm(), 0, 1e-12);
}

TEST(FluxEffects, ThatLeaveNoInductanceOrHaveNoPlaceAreRefused) {
  const std::string drive = "preset = \"dilys2021\"\n";
  const std::string half = "[[effect]]\nkind = \"inductance\"\nchange_d_H = ";
  const auto parse = [&](const std::string& text) { Config::parse(drive + text, "drive.toml"); };
  const double L_d = Config::parse(drive, "drive.toml").drive().machine.L_d;
  const std::string taken = half + std::to_string(-0.6 * L_d) + "\nchange_q_H = 0.0\n";
  EXPECT_NO_THROW(parse(taken));
  EXPECT_THROW(parse(taken + taken), BadInput);
  // c i_q of cross saturation beyond L: refused where the rated current is known.
  const std::string cross = "[[effect]]\nkind = \"cross_saturation\"\ncoefficient_H_A = ";
  EXPECT_THROW(Config::parse("preset = \"niewiara2020\"\n" + cross + "3e-3\n", "drive.toml"),
               BadInput);
  EXPECT_NO_THROW(Config::parse("preset = \"niewiara2020\"\n" + cross + "1e-3\n", "drive.toml"));
  EXPECT_THROW(parse("[plant]\nsaliency = \"fixed_axes\"\n" + taken), BadInput);
}

}  // namespace
}  // namespace twinrate::flux_effects_test

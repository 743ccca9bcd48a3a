// Each effect against its closed form: sign, size, and the orders it makes.
#include <gtest/gtest.h>

#include <complex>
#include <functional>

#include "model/sensors.hpp"
#include "tests/support/effects.hpp"

namespace twinrate {
namespace {

using test::effect_of;

// Coefficient of e^{j order angle} of a function of the angle, two-sided.
std::complex<double> harmonic(const std::function<double(double)>& f, int order) {
  constexpr int kPoints = 7200;
  std::complex<double> sum = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double angle = (i + 0.5) * kTwoPi / kPoints;
    sum += f(angle) * std::polar(1.0, -order * angle);
  }
  return sum / static_cast<double>(kPoints);
}
double amplitude(const std::function<double(double)>& f, int order) {
  return 2 * std::abs(harmonic(f, order));
}

OperatingPoint at_angle(double theta_m, const Vec2& i_dq, double omega_m = 1) {
  return {
      .i_dq = i_dq, .v_dc = 235.4, .omega_m = omega_m, .theta_m = theta_m, .theta_e = 3 * theta_m};
}

TEST(DeadTime, OneMicrosecondAtTenKilohertzLosesTheReferencesVoltage) {
  const auto effect = effect_of("dead_time", {{"dead_time_s", 1e-6}});
  // i_a = 5, i_b = i_c = -2.5 A: drops 2.354, -2.354, -2.354 V, alpha = 4/3 of one.
  const Vec2 drop = effect->at(at_angle(0, {5, 0})).u_dq_drop;
  EXPECT_NEAR(drop[0], 4.0 / 3 * 2.354, 1e-9);
  EXPECT_NEAR(drop[1], 0, 1e-9);
}

TEST(DeadTime, MakesTheHarmonicsOfAThreePhaseSquareWave) {
  const auto effect = effect_of("dead_time", {{"dead_time_s", 1e-6}});
  const auto along = [&](double theta_m) {
    return effect->at(at_angle(theta_m, {0, 500})).u_dq_drop[1];
  };
  const auto across = [&](double theta_m) {
    return effect->at(at_angle(theta_m, {0, 500})).u_dq_drop[0];
  };
  const double fundamental = 4 / kPi * 2.354;
  EXPECT_NEAR(harmonic(along, 0).real(), fundamental, 2e-3 * fundamental);
  // Fifth and seventh of the phases are order 6 of the electrical turn: 18 of the mechanical one.
  EXPECT_NEAR(amplitude(along, 18), 2.0 / 35 * fundamental, 2e-3 * fundamental);
  EXPECT_NEAR(amplitude(across, 18), 12.0 / 35 * fundamental, 2e-3 * fundamental);
  EXPECT_NEAR(amplitude(across, 36), 24.0 / 143 * fundamental, 2e-3 * fundamental);
  for (int order : {3, 6, 9, 12, 27}) {
    EXPECT_LT(amplitude(along, order), 1e-3) << order;
    EXPECT_LT(amplitude(across, order), 1e-3) << order;
  }
}

TEST(DeadTime, IsAResistanceBelowItsLinearCurrent) {
  const auto effect = effect_of("dead_time", {{"dead_time_s", 1e-6}});
  for (double theta_m : {0.0, 0.2, 1.9}) {
    const Vec2 i_dq(0.05, -0.2);
    const Vec2 drop = effect->at(at_angle(theta_m, i_dq)).u_dq_drop;
    EXPECT_NEAR((drop - 2.354 / 0.3 * i_dq).norm(), 0, 1e-9);
  }
}

TEST(DeadTime, OfHalfAPeriodIsRefused) {
  const auto effect = make_effect("dead_time");
  test::FieldSetter set({{"dead_time_s", 6e-5}});
  effect->fields(set);
  EXPECT_NE(effect->prepare(test::drive_facts()), "");
}

TEST(InverterDrop, IsThresholdPlusResistance) {
  const auto effect = effect_of("inverter_drop", {{"threshold_V", 0.8}, {"resistance_Ohm", 0.1}});
  const Vec2 drop = effect->at(at_angle(0, {5, 0})).u_dq_drop;
  EXPECT_NEAR(drop[0], 4.0 / 3 * 0.8 + 0.5, 1e-9);
  const Vec2 back = effect->at(at_angle(0, {-5, 0})).u_dq_drop;
  EXPECT_NEAR(back[0], -drop[0], 1e-12);
}

TEST(FluxHarmonics, TakeFromTheTerminalsWhatTheyGiveToTheShaft) {
  const auto effect =
      effect_of("flux_harmonics", {{"order", 18}, {"amplitude_Wb", 1e-3}, {"phase_rad", 0.4}});
  double size = 0;
  for (int i = 0; i < 200; ++i) {
    const Vec2 i_dq(std::sin(0.9 * i), 3 * std::cos(0.31 * i));
    const double omega_m = 20 * std::sin(0.17 * i + 1);
    const Contribution c = effect->at(at_angle(0.05 * i, i_dq, omega_m));
    EXPECT_NEAR(1.5 * i_dq.dot(c.u_dq_drop), -c.T_load * omega_m, 1e-12);
    size = std::max(size, std::abs(c.T_load * omega_m));
  }
  EXPECT_GT(size, 0.1);
}

TEST(FluxHarmonics, VoltageIsTheTimeDerivativeOfTheFlux) {
  const auto effect =
      effect_of("flux_harmonics", {{"order", 18}, {"amplitude_Wb", 1e-3}, {"phase_rad", 0.4}});
  const double omega_m = 7, h = 1e-6;
  for (double theta_m : {0.0, 0.3, 2.0}) {
    const auto flux = [&](double theta) { return 1e-3 * std::cos(18 * theta + 0.4); };
    const Vec2 drop = effect->at(at_angle(theta_m, {0, 0}, omega_m)).u_dq_drop;
    const double slope = (flux(theta_m + omega_m * h) - flux(theta_m - omega_m * h)) / (2 * h);
    EXPECT_NEAR(drop[0], slope, 1e-6);
    EXPECT_NEAR(drop[1], 3 * omega_m * flux(theta_m), 1e-12);
  }
}

TEST(FluxHarmonics, MoreFluxIsMoreTorqueForAPositiveQCurrent) {
  const auto effect = effect_of("flux_harmonics", {{"order", 18}, {"amplitude_Wb", 1e-3}});
  EXPECT_NEAR(effect->at(at_angle(0, {0, 2})).T_load, -4.5 * 1e-3 * 2, 1e-15);
}

TEST(Cogging, TakesItsOrdersFromTheSlotsAndPolesOfTheMachine) {
  // 27 slots, 6 poles: least common multiple 54.
  const auto order_of = [](int origin) {
    const auto effect = make_effect("cogging");
    class Set final : public test::FieldSetter {
     public:
      explicit Set(int origin)
          : FieldSetter({{"order", 1}, {"amplitude_Nm", 1}}), origin_(origin) {}
      void choice(const char*, int& index, std::span<const char* const>, const char*) override {
        index = origin_;
      }
      int origin_;
    } set(origin);
    effect->fields(set);
    EXPECT_EQ(effect->prepare(test::drive_facts()), "");
    const auto torque = [&](double theta_m) { return effect->at({.theta_m = theta_m}).T_load; };
    for (int order = 1; order <= 120; ++order)
      if (amplitude(torque, order) > 0.999) return order;
    return 0;
  };
  EXPECT_EQ(order_of(0), 1);
  EXPECT_EQ(order_of(1), 54);
  EXPECT_EQ(order_of(2), 27);
  EXPECT_EQ(order_of(3), 6);
}

TEST(CurrentOffset, TurnsAtTheOrderOfThePolePairs) {
  const auto effect = effect_of(
      "current_offset", {{"offset_a_A", 0.05}, {"offset_b_A", -0.02}, {"offset_c_A", -0.03}});
  for (int axis : {0, 1}) {
    const auto error = [&](double theta_m) {
      return park(clarke(effect->at(at_angle(theta_m, {1, 2})).i_abc), 3 * theta_m)[axis];
    };
    EXPECT_NEAR(amplitude(error, 3), std::hypot(0.05, 0.01 / std::sqrt(3.0)), 1e-12);
    for (int order : {0, 6, 9, 18}) EXPECT_LT(amplitude(error, order), 1e-12);
  }
}

TEST(CurrentGain, OfTwoSensorsMakesChungAndSulsError) {
  const double g_a = 0.015, g_b = -0.004, I = 5;
  const auto effect = effect_of("current_gain", {{"gain_a", g_a}, {"gain_b", g_b}});
  const SensorParameters two_sensors{.current_sensors = 2};
  for (double theta_m : {0.0, 0.2, 0.9, 2.5}) {
    const OperatingPoint point = at_angle(theta_m, {I, 0});
    const Vec3 i_meas = sample_currents(two_sensors, point.i_abc() + effect->at(point).i_abc, 1, 0);
    const double i_q_error = park(clarke(i_meas), point.theta_e)[1];
    EXPECT_NEAR(i_q_error,
                (g_a - g_b) * I / std::sqrt(3.0) * (std::cos(2 * point.theta_e + kPi / 3) + 0.5),
                1e-12);
  }
}

TEST(CurrentGain, MakesAConstantAndOrderTwoOfTheElectricalTurnInProportionToTheCurrent) {
  const auto effect = effect_of("current_gain", {{"gain_a", 0.03}, {"gain_b", 0}});
  for (double i_q : {1.0, 4.0}) {
    const auto error = [&](double theta_m) {
      return park(clarke(effect->at(at_angle(theta_m, {0, i_q})).i_abc), 3 * theta_m)[1];
    };
    // Three sensors: 2/3 g I sin^2(theta_e).
    EXPECT_NEAR(harmonic(error, 0).real(), 0.01 * i_q, 1e-12);
    EXPECT_NEAR(amplitude(error, 6), 0.01 * i_q, 1e-12);
    EXPECT_LT(amplitude(error, 3), 1e-12);
  }
}

TEST(StribeckFriction, IsTheExcessAtLowSpeedAndGoneAtHighSpeed) {
  const auto effect = effect_of("stribeck_friction", {{"torque_Nm", 0.1}, {"speed_rad_s", 1.5}});
  EXPECT_NEAR(effect->at({.omega_m = 1.5}).T_load, 0.1 * std::exp(-1.0), 1e-12);
  EXPECT_NEAR(effect->at({.omega_m = 0.1}).T_load, 0.1, 5e-4);
  EXPECT_NEAR(effect->at({.omega_m = -0.1}).T_load, -0.1, 5e-4);
  EXPECT_NEAR(effect->at({.omega_m = 6}).T_load, 0, 1e-7);
  const auto tustin =
      effect_of("stribeck_friction", {{"torque_Nm", 0.1}, {"speed_rad_s", 1.5}, {"exponent", 1}});
  EXPECT_NEAR(tustin->at({.omega_m = -3}).T_load, -0.1 * std::exp(-2.0), 1e-12);
}

TEST(FrictionRipple, ChangesItsSignWithTheDirectionAndCoggingDoesNot) {
  const auto rub =
      effect_of("friction_ripple", {{"order", 1}, {"amplitude_Nm", 0.05}, {"phase_rad", 0.5}});
  const auto cogging =
      effect_of("cogging", {{"order", 1}, {"amplitude_Nm", 0.05}, {"phase_rad", 0.5}});
  for (double theta_m : {0.3, 2.0, 4.0}) {
    const OperatingPoint forward{.omega_m = 2, .theta_m = theta_m};
    const OperatingPoint backward{.omega_m = -2, .theta_m = theta_m};
    EXPECT_NEAR(rub->at(forward).T_load, 0.05 * std::sin(theta_m + 0.5), 1e-12);
    EXPECT_NEAR(rub->at(backward).T_load, -rub->at(forward).T_load, 1e-12);
    EXPECT_EQ(cogging->at(backward).T_load, cogging->at(forward).T_load);
  }
}

TEST(Loads, HaveTheirSigns) {
  const auto torque = [](const char* kind, std::map<std::string, double> values,
                         const OperatingPoint& point) {
    return effect_of(kind, std::move(values))->at(point).T_load;
  };
  EXPECT_NEAR(torque("fan_load", {{"coefficient_Nms2", 2e-3}}, {.omega_m = 10}), 0.2, 1e-15);
  EXPECT_NEAR(torque("fan_load", {{"coefficient_Nms2", 2e-3}}, {.omega_m = -10}), -0.2, 1e-15);
  EXPECT_NEAR(torque("viscous_friction", {{"coefficient_Nms", 0.01}}, {.omega_m = -5}), -0.05,
              1e-15);
  EXPECT_EQ(torque("constant_load", {{"torque_Nm", 0.3}}, {.omega_m = -5}), 0.3);
  EXPECT_EQ(torque("load_step", {{"torque_Nm", 0.3}, {"time_s", 2}}, {.t = 1.999}), 0);
  EXPECT_EQ(torque("load_step", {{"torque_Nm", 0.3}, {"time_s", 2}}, {.t = 2}), 0.3);
  EXPECT_NEAR(torque("eccentric_load", {{"amplitude_Nm", 0.2}, {"phase_rad", 0.1}},
                     {.theta_m = kPi / 2 - 0.1}),
              0.2, 1e-15);
}

TEST(Sensors, EncoderAndBusHaveTheirSigns) {
  EXPECT_EQ(effect_of("encoder_offset", {{"offset_rad", 0.02}})->at({}).theta_m, 0.02);
  const auto disc =
      effect_of("encoder_eccentricity", {{"amplitude_rad", 1e-3}, {"phase_rad", 0.3}});
  EXPECT_NEAR(disc->at({.theta_m = kPi / 2 - 0.3}).theta_m, 1e-3, 1e-15);
  const auto bus =
      effect_of("dc_bus_ripple", {{"amplitude_V", 5}, {"frequency_Hz", 300}, {"phase_rad", 0.2}});
  EXPECT_NEAR(bus->at({.t = (kPi / 2 - 0.2) / (kTwoPi * 300)}).v_dc, 5, 1e-12);
}

}  // namespace
}  // namespace twinrate

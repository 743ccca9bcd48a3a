// An electrical effect in the model: the one-step prediction of the currents is as good as without
// the effect in the drive, and the estimated load is correct.
#include <gtest/gtest.h>

#include "core/config.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

struct Errors {
  double currents = 0;  // A, rms of the one-step prediction of i_dq
  double load = 0;      // Nm, mean error of the estimated load at constant speed and load
};

// 300 rpm, 3 Nm from 0.4 s on, 1.5 A of d current from 0.7 s on; both steps are in the figures.
Errors errors_with(const std::string& effect, const std::string& used_in) {
  Config config = Config::parse(
      "preset = \"niewiara2020\"\n[reference]\nspeed_rpm = 300.0\nslew_rad_s2 = 200.0\n"
      "i_d_A = [[0, 0], [0.69999, 0], [0.7, 1.5]]\n[load]\nT_load_Nm = [[0, 0], [0.39999, 0], "
      "[0.4, 3]]\n[run]\nduration_s = 1.3\n[estimator]\nprediction = \"rk4\"\n[[effect]]\n" +
          effect + "used_in = \"" + used_in + "\"\n",
      "drive.toml");
  ClosedLoop loop(config);
  const DriveConfig& drive = config.drive();
  Errors errors;
  int count = 0, settled = 0;
  for (std::int64_t k = 0; k < drive.steps(); ++k) {
    const TickRecord& tick = loop.step();
    const double t_s = static_cast<double>(k) * drive.T_s();
    if (t_s < 0.3) continue;
    errors.currents += tick.estimate.innov.head<2>().squaredNorm();
    ++count;
    if (t_s < 1.1) continue;
    errors.load += tick.estimate.T_load - tick.truth.T_load - drive.machine.B * tick.truth.omega_m;
    ++settled;
  }
  errors.currents = std::sqrt(errors.currents / count);
  errors.load = std::abs(errors.load / settled);
  return errors;
}

struct Case {
  const char* kind;
  const char* parameters;
  double currents;  // smallest ratio of the prediction error without the effect in the model
  double load;      // Nm, smallest error of the estimated load without the effect in the model
};

class KnownElectrical : public testing::TestWithParam<Case> {};

TEST_P(KnownElectrical, EffectsArePredicted) {
  const Case& c = GetParam();
  const std::string effect = std::string("kind = \"") + c.kind + "\"\n" + c.parameters;
  const Errors unknown = errors_with(effect, "plant"), known = errors_with(effect, "both");
  const Errors without = errors_with("kind = \"constant_load\"\ntorque_Nm = 0.0\n", "plant");
  EXPECT_LT(known.currents, 1.02 * without.currents);
  EXPECT_GT(known.currents, 0.98 * without.currents);
  EXPECT_LT(known.load, 1e-3);
  EXPECT_GT(unknown.currents, c.currents * known.currents);
  EXPECT_GE(unknown.load, c.load);
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, KnownElectrical,
    testing::Values(Case{"resistance", "change_Ohm = 0.5\n", 3, 0.02},
                    Case{"flux_linkage", "change_Wb = -0.02\n", 3.5, 0.15},
                    Case{"inductance", "change_d_H = 4e-3\nchange_q_H = -4e-3\n", 2.7, 0.1},
                    Case{"saturation", "current_q_A = 6.0\ncurrent_d_A = 6.0\n", 2.7, 0.03},
                    Case{"cross_saturation", "coefficient_H_A = 1e-3\n", 1.3, 0.005},
                    Case{"inverter_offset", "offset_a_V = 1.5\noffset_b_V = -1.0\n", 3.3, 0},
                    Case{"phase_asymmetry", "change_a_Ohm = 0.5\n", 1.7, 0.007},
                    Case{"iron_loss", "resistance_Ohm = 100.0\n", 1.2, 0.2},
                    Case{"voltage_gain", "gain = 0.05\n", 2.6, 0.025}),
    [](const auto& i) { return std::string(i.param.kind); });

}  // namespace
}  // namespace twinrate::test

// Shafts against errors of the angle.
#include "trace/angle_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>

#include "model/frames.hpp"
#include "model/random.hpp"
#include "tests/trace/fitted_drive.hpp"

namespace twinrate {
namespace {

constexpr Eigen::Index kRows = 4096;
constexpr double kOutput_s = 1e-3;

// One run of rows, all of them judging.
Runs all_judge() {
  Runs runs{.row = std::vector<std::size_t>(kRows), .start = {0}};
  runs.held_out.assign(kRows, 1);
  return runs;
}

Eigen::VectorXd line(double f_Hz, double amplitude) {
  return amplitude *
         (kTwoPi * f_Hz * kOutput_s * Eigen::ArrayXd::LinSpaced(kRows, 0, kRows - 1)).sin();
}

Eigen::VectorXd white(std::uint64_t stream) {
  Eigen::VectorXd x(kRows);
  for (Eigen::Index k = 0; k < kRows; ++k) x[k] = normal(3, stream, static_cast<std::uint64_t>(k));
  return x;
}

AngleErrorFall fall(const Members& claimed, const Eigen::VectorXd& with,
                    const Eigen::VectorXd& without) {
  return fall_of_angle_error(claimed, with, {}, without, servo().machine, all_judge(), kOutput_s);
}

Members shaft(double J_load, double f_Hz, double damping) {
  return {effect_with("torsion", {{"J_load_kgm2", J_load},
                                  {"stiffness_Nm_rad", J_load * std::pow(kTwoPi * f_Hz, 2)},
                                  {"damping_Nms_rad", damping}})};
}

TEST(AngleError, OfLessInertiaIsLessByItsSquare) {
  const double J = servo().machine.J;
  const Members lighter = {effect_with("inertia", {{"change_kgm2", -0.3 * J}})};
  EXPECT_NEAR(fall(lighter, white(1), white(1)).share, 1 - 0.7 * 0.7, 1e-9);
}

// Z / (J s^2) in closed form, where the bilinear rule is exact: at the antiresonance.
TEST(AngleError, OfAShaftIsThatOfTheClosedForm) {
  const double J = servo().machine.J, J_load = 0.4 * J, f_Hz = 80, damping = 0.6;
  const std::complex<double> s(0, kTwoPi * f_Hz);
  const double k = J_load * std::pow(kTwoPi * f_Hz, 2);
  const std::complex<double> F = (damping * s + k) / (J_load * s * s + damping * s + k);
  const double left = std::norm((J - J_load + J_load * F) / J);
  const Eigen::VectorXd x = line(f_Hz, 1);
  EXPECT_NEAR(1 - fall(shaft(J_load, f_Hz, damping), x, x).share, left, 0.03 * left);
}

// In a gap the load is loose: the motor's own inertia makes the torque of the error, whatever the shaft.
TEST(AngleError, OfALooseLoadIsThatOfTheMotorAlone) {
  const double J = servo().machine.J;
  for (const double f_Hz : {10., 80.})
    EXPECT_NEAR(fall(shaft(0.4 * J, f_Hz, 0.01), white(1), white(1)).loose, 1 - 0.6 * 0.6, 1e-9);
}

// The claim takes off nearly all of a loud line, and doubles the rest.
TEST(AngleError, OneLineHoweverLoudIsOneFrequency) {
  const Members lighter = {effect_with("inertia", {{"change_kgm2", -0.3 * servo().machine.J}})};
  const Eigen::VectorXd without = line(212, 30) + white(1);
  const AngleErrorFall of_line = fall(lighter, line(212, 1) + 2 * white(1), without);
  EXPECT_GT(of_line.log_ratio, 0.5);
  const AngleErrorFall of_all = fall(lighter, 0.3 * without, without);
  EXPECT_NEAR(of_all.log_ratio, 2 * std::log(0.3 / 0.7), 1e-6);
}

// A motor with hardly any inertia makes hardly any torque of any error of the angle: nothing may be claimed by that.
TEST(AngleError, AWeightlessMotorLowersAnyErrorOfTheAngle) {
  const Members weightless = {
      effect_with("inertia", {{"change_kgm2", -0.999 * servo().machine.J}})};
  const AngleErrorFall all = fall(weightless, 0.01 * white(1), white(1));
  EXPECT_TRUE(all.lighter);
  EXPECT_NEAR(all.share, 1, 1e-5);
  EXPECT_GT(all.log_ratio, 0);
}

TEST(AngleError, RunsTooShortForAFrequencySayNothing) {
  const Members lighter = {effect_with("inertia", {{"change_kgm2", -1e-3}})};
  Runs runs = all_judge();
  for (std::size_t first = 10; first < static_cast<std::size_t>(kRows); first += 10)
    runs.start.push_back(first);
  const AngleErrorFall short_runs =
      fall_of_angle_error(lighter, white(1), {}, white(1), servo().machine, runs, kOutput_s);
  EXPECT_TRUE(std::isnan(short_runs.log_ratio));
}

}  // namespace
}  // namespace twinrate

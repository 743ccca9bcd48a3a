// Hidden motors: what an identification finds against what the plant has.
#include "identify/identify.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>

#include "identify/admittance.hpp"
#include "identify/segmented_fit.hpp"
#include "identify/simulated_rig.hpp"
#include "identify/standstill.hpp"
#include "loop/load_drive.hpp"
#include "model/random.hpp"

namespace twinrate::test {
namespace {

void expect_within(const Found& found, double truth, double share) {
  EXPECT_NEAR(found.value, truth, share * truth);
  EXPECT_GT(found.sigma, 0);
  EXPECT_LT(found.sigma, share * truth);
}

// A motor that its sheet describes wrongly, on an inverter with dead time, with the encoder the
// wrong way round and its zero anywhere.
constexpr const char* kHiddenEffects = R"(
[[effect]]
kind = "dead_time"
dead_time_s = 1.5e-6
linear_current_A = 0.1
[[effect]]
kind = "coulomb_friction"
torque_Nm = 2e-3
[[effect]]
kind = "encoder_offset"
offset_rad = 0.3
)";

Config hidden() {
  Config config =
      Config::parse(load_drive("dilys2021").resolved() + kHiddenEffects, "hidden",
                    {"sensors.encoder_counts=8192", "machine.R_s_Ohm=0.71", "machine.L_d_H=0.34e-3",
                     "machine.psi_f_Wb=0.0093", "machine.J_kgm2=2.3e-5", "machine.B_Nms=2.1e-5",
                     "plant.theta_e_start_rad=2.5"});
  read_all_tables(config);
  return config;
}

// I/U of a held voltage on 1/(L s + R + c s/(s^2 + d omega s + k)): the sum over the aliases of its sine.
std::complex<double> held_admittance(double L, double R, double c, double k, double d, double T_s,
                                     int period) {
  using Complex = std::complex<double>;
  constexpr int kAliases = 100000;
  const double omega = kTwoPi / (period * T_s);
  Complex sum;
  for (int m = -kAliases; m <= kAliases; ++m) {
    const Complex s(0, omega + m * kTwoPi / T_s);
    sum += 1.0 / (L * s + R + c * s / (s * s + d * omega * s + k)) / (s * T_s);
  }
  return sum * (1.0 - std::polar(1.0, -omega * T_s)) * std::polar(1.0, omega * T_s);
}

// A light rotor swings far under the slow sines, a heavy one not at all; with 2e-4 of noise in
// each sine L stays.
TEST(AxisFit, FindsTheInductanceOfLightAndOfHeavyRotors) {
  struct Axis {
    double L, R, c, k, d, f_s;
  };
  for (const Axis& a :
       {Axis{7.3e-3, 4.0, 980, 6.7e3, 0, 5214}, Axis{1.85e-4, 0.0245, 40, 3e4, 1e-3, 5870},
        Axis{3.3e-4, 0.05, 1e-3, 10, 0.3, 8000}, Axis{2e-3, 0.5, 3000, 1e5, 0.05, 10000}}) {
    std::vector<Sine> sines;
    for (const int period : {6, 8, 12, 16, 24, 32, 48, 64}) {
      const double noise = 2e-4 * (period % 16 == 0 ? 1 : -1);
      sines.push_back(
          {period, held_admittance(a.L, a.R, a.c, a.k, a.d, 1 / a.f_s, period) * (1 + noise), 1});
    }
    const AxisFit fit = fit_axis(sines, 1 / a.f_s, a.R, true);
    EXPECT_NEAR(fit.L.value, a.L, 2e-3 * a.L) << a.c;
    EXPECT_LT(fit.L.sigma, 2e-3 * a.L) << a.c;
    EXPECT_NEAR(fit.R.value, a.R, 0.02 * a.R) << a.c;
  }
}

TEST(Identify, FindsAHiddenMotorOnALossyInverterWiredTheWrongWay) {
  const Config config = hidden();
  SimulatedRig rig(config, {.swapped_phases = false, .reversed_encoder = true});
  const Identified found = identify(rig, {.i_max = 1.5, .omega_m_max = 420}, {});
  EXPECT_EQ(found.n_p, 4);
  EXPECT_TRUE(found.mirrored);
  expect_within(found.R_s, 0.71, 0.01);
  expect_within(found.L_d, 0.34e-3, 0.01);
  expect_within(found.L_q, 0.5e-3, 0.01);
  expect_within(found.psi_f, 0.0093, 0.01);
  expect_within(found.J, 2.3e-5, 0.03);
  const double omega = found.omega_m_max;
  EXPECT_NEAR(found.B.value * omega + found.T_coulomb.value, 2.1e-5 * omega + 2e-3,
              0.05 * (2.1e-5 * omega + 2e-3));
  EXPECT_NEAR(found.loss.V.value, 1.5e-6 * 5e3 * 24, 0.1 * 1.5e-6 * 5e3 * 24);

  // The file of it loads, says what to mend, and has the zero of the encoder.
  const std::string text = identified_toml(config, found);
  EXPECT_NE(text.find("negated"), std::string::npos);
  Config identified = Config::parse(text, "identified.toml");
  read_all_tables(identified);
  EXPECT_EQ(identified.drive().machine.psi_f, std::stod(fmt::format("{:.6e}", found.psi_f.value)));
  std::vector<std::string> kinds;
  for (const auto& e : identified.drive().effects) kinds.emplace_back(e.effect->kind());
  EXPECT_EQ(kinds,
            (std::vector<std::string>{"inverter_drop", "coulomb_friction", "encoder_offset"}));
  const auto at = text.rfind("offset_rad = ");
  const double offset = std::stod(text.substr(at + 13));
  EXPECT_LT(std::abs(wrap_pi(4 * (offset - 0.3))), 0.02);
}

TEST(Identify, AShaftThatDoesNotTurnIsToldNotGuessed) {
  Config config =
      Config::parse(load_drive("dilys2021").resolved(), "blocked", {"machine.J_kgm2=1e3"});
  read_all_tables(config);
  SimulatedRig rig(config, {});
  try {
    identify(rig, {.i_max = 1.5}, {});
    FAIL() << "identified a blocked motor";
  } catch (const RunFailed& failed) {
    EXPECT_NE(std::string(failed.what()).find("blocked"), std::string::npos) << failed.what();
  }
}

TEST(Identify, AWrongSheetIsNamedWithItsFactor) {
  const MachineParameters right = load_drive("dilys2021").drive().machine;
  Identified found;
  found.n_p = right.n_p;
  found.R_s.value = right.R_s, found.L_d.value = right.L_d, found.L_q.value = right.L_q;
  found.psi_f.value = right.psi_f, found.J.value = right.J;
  for (Found* f : {&found.R_s, &found.L_d, &found.L_q, &found.psi_f, &found.J})
    f->sigma = 1e-3 * f->value;
  const auto verdict = [&](const MachineParameters& sheet, const std::string& key) {
    for (const SheetRow& row : compare(found, sheet))
      if (row.key == key) return row.verdict;
    return std::string("no row");
  };
  MachineParameters wrong = right;
  wrong.R_s *= 2, wrong.L_d *= 2, wrong.psi_f *= std::sqrt(3.0), wrong.J *= 1e7, wrong.n_p *= 2;
  EXPECT_NE(verdict(wrong, "R_s").find("line to line"), std::string::npos);
  EXPECT_NE(verdict(wrong, "L_d").find("line to line"), std::string::npos);
  EXPECT_NE(verdict(wrong, "psi_f").find("1/sqrt(3)"), std::string::npos);
  EXPECT_NE(verdict(wrong, "J").find("g cm2"), std::string::npos);
  EXPECT_NE(verdict(wrong, "n_p").find("pole pairs"), std::string::npos);
  for (const char* key : {"n_p", "R_s", "L_d", "L_q", "psi_f", "J"})
    EXPECT_EQ(verdict(right, key).substr(0, 6), "agrees") << key;
  // 0.69 lies between 2/3 and 1/sqrt(2): both are named.
  wrong = right;
  wrong.psi_f /= 0.687;
  EXPECT_NE(verdict(wrong, "psi_f").find("1/sqrt(2)"), std::string::npos);
  EXPECT_NE(verdict(wrong, "psi_f").find("2/3"), std::string::npos);
  // With a sigma of its own size every value would agree.
  found.J = {2e3 * right.J, 2e3 * right.J};
  EXPECT_NE(verdict(right, "J").find("not identified"), std::string::npos);
  const Config sheet = load_drive("dilys2021");
  Config file = Config::parse(identified_toml(sheet, found), "identified.toml");
  read_all_tables(file);
  EXPECT_EQ(file.drive().machine.J, right.J);
}

TEST(Identify, AnInductanceThatFallsIsASaturationAndOneThatStaysIsNone) {
  std::vector<InductancePoint> falling, level;
  for (const double i : {0.3, 0.5, 0.75, 1.0}) {
    const double L = 2e-3 / std::pow(1 + i / 5, 2);
    falling.push_back({i, {L, 1e-3 * L}, true});
    level.push_back({i, {2e-3 * (1 + 5e-4 * std::sin(40 * i)), 2e-6}, true});
  }
  const InductanceFit fit = fit_inductance(falling);
  ASSERT_TRUE(fit.saturation);
  EXPECT_NEAR(fit.L.value, 2e-3, 2e-5);
  EXPECT_FALSE(fit_inductance(level).saturation);
  EXPECT_NEAR(fit_inductance(level).L.value, 2e-3, 2e-6);
}

// A file has one form for both axes: the scale of an axis is that of the form in the file. Points
// of a motor that saturates as the rational form along both; along q alone tanh fits better.
TEST(Identify, BothAxesAreFittedWithTheFormThatTheFileHas) {
  const std::vector<InductancePoint> d = {{0.45, {4.5652e-4, 5e-7}, true},
                                          {0.75, {4.3182e-4, 4e-7}, true},
                                          {1.125, {4.0411e-4, 3e-7}, true},
                                          {1.5, {3.7852e-4, 3e-7}, true}};
  const std::vector<InductancePoint> q = {{0.2574, {4.8057e-4, 4.4e-7}, false},
                                          {0.375, {4.8657e-4, 2e-5}, false},
                                          {0.75, {4.6486e-4, 9.8e-6}, false},
                                          {1.125, {4.4086e-4, 6.4e-6}, false},
                                          {1.5, {4.2121e-4, 4.8e-6}, false}};
  ASSERT_NE(fit_inductance(d).saturation->form, fit_inductance(q).saturation->form);
  const InductanceFits fits = fit_inductances(d, q);
  ASSERT_TRUE(fits.d.saturation && fits.q.saturation);
  EXPECT_EQ(fits.d.saturation->form, fits.q.saturation->form);
  EXPECT_NEAR(fits.q.L.value, 5e-4, 2 * fits.q.L.sigma);
  EXPECT_NEAR(fits.q.L.value, 5e-4, 0.02 * 5e-4);
}

// 25 % more resistance with a time constant of 20 s stood as a loss of 0.17 V in the file.
TEST(Identify, AWindingThatWarmsIsNoLossOfTheInverter) {
  Config config = Config::parse(load_drive("dilys2021").resolved() +
                                    "\n[[effect]]\nkind = \"resistance\"\nchange_Ohm = 0.3\n"
                                    "time_constant_s = 20.0\n",
                                "warm", {"sensors.encoder_counts=8192"});
  read_all_tables(config);
  SimulatedRig rig(config, {});
  Experiment e(rig, limits_of(config.drive()), {});
  Identified found;
  identify_standstill(e, found);
  EXPECT_LT(std::abs(found.loss.V.value), 0.02);
  ASSERT_FALSE(found.notes.empty());
  EXPECT_NE(found.notes.front().find("R_s: changed by +"), std::string::npos);
}

TEST(Identify, AFanIsItsOwnTorqueAndNoFriction) {
  Config config = Config::parse(load_drive("dilys2021").resolved() +
                                    "\n[[effect]]\nkind = \"fan_load\"\ncoefficient_Nms2 = 1e-7\n",
                                "fan", {"sensors.encoder_counts=8192"});
  read_all_tables(config);
  SimulatedRig rig(config, {});
  const Identified found = identify(rig, limits_of(config.drive()), {});
  EXPECT_NEAR(found.fan.value, 1e-7, 5e-9);
  EXPECT_EQ(found.T_coulomb.value, 0);
  expect_within(found.J, 1e-5, 0.03);
  // The errors of the offsets and of the ramps are in the sigmas.
  EXPECT_NEAR(found.R_s.value, 1.2, 3 * found.R_s.sigma);
  EXPECT_NEAR(found.J.value, 1e-5, 3 * found.J.sigma);
  EXPECT_NE(identified_toml(config, found).find("fan_load"), std::string::npos);
}

Identified with_effects(const std::string& effects) {
  Config config = Config::parse(load_drive("dilys2021").resolved() + effects, "faulty",
                                {"sensors.encoder_counts=8192"});
  read_all_tables(config);
  SimulatedRig rig(config, {});
  return identify(rig, {.i_max = 1.5, .omega_m_max = 280}, {});
}

bool says(const Identified& found, const std::string& what) {
  return std::any_of(found.notes.begin(), found.notes.end(),
                     [&](const std::string& note) { return note.find(what) == 0; });
}

TEST(Identify, ARightDriveHasNoFaultOfItsReadings) {
  const Identified found = with_effects("");
  for (const char* what :
       {"stale", "currents:", "angle:", "a torque once", "phases:", "friction may"})
    EXPECT_FALSE(says(found, what)) << what;
}

// Stale currents stood as 4 % of inductance, unbalance as 6 % of inertia; the shaft is not at rest
// at first.
TEST(Identify, StaleCurrentsAndUnbalanceAreToldAndTakenIntoAccount) {
  const Identified found = with_effects(
      "\n[[effect]]\nkind = \"stale_samples\"\nsignal = \"current\"\nshare = 0.05\n"
      "[[effect]]\nkind = \"eccentric_load\"\namplitude_Nm = 0.003\nphase_rad = 0.5\n");
  EXPECT_TRUE(says(found, "stale readings"));
  EXPECT_NEAR(found.stale_share, 0.05, 0.01);
  expect_within(found.L_d, 5e-4, 0.01);
  expect_within(found.L_q, 5e-4, 0.01);
  expect_within(found.J, 1e-5, 0.03);
  EXPECT_TRUE(says(found, "a torque once a turn"));
  EXPECT_NEAR(std::hypot(found.T_sin.value, found.T_cos.value), 3e-3, 2e-4);
  EXPECT_NEAR(std::atan2(found.T_cos.value, found.T_sin.value), 0.5, 0.1);
}

// An angle one tick late stood as an inertia 2 % too small at 19 sigmas, a phase with 0.1 Ohm more
// as a resistance 5 % too large at 80.
TEST(Identify, ALateAngleAndAPhaseWithMoreResistanceAreTold) {
  const Identified found = with_effects(
      "\n[[effect]]\nkind = \"signal_lag\"\nsignal = \"angle\"\nform = \"delay\"\nlag_s = 2e-4\n"
      "[[effect]]\nkind = \"phase_asymmetry\"\nchange_a_Ohm = 0.1\n");
  EXPECT_TRUE(says(found, "angle: read"));
  EXPECT_NEAR(found.angle_lag.value, 2e-4, 1e-5);
  EXPECT_NEAR(found.J.value, 1e-5, 0.005e-5);
  EXPECT_NEAR(found.psi_f.value, 0.007, 0.002 * 0.007);
  EXPECT_TRUE(says(found, "phases:"));
  EXPECT_NEAR(found.R_s.value, 1.2 + 0.1 / 3, 0.005);
}

// Three per cent of harmonics stood as 70 % of viscous friction.
TEST(Identify, FluxHarmonicsAreToldBesideTheFrictionThatTheyShift) {
  const Identified found =
      with_effects("\n[[effect]]\nkind = \"flux_harmonics\"\norder = 24\namplitude_Wb = 2.1e-4\n");
  EXPECT_TRUE(says(found, "friction may be shifted: the flux linkage has harmonics, 3"));
  EXPECT_NEAR(found.flux_harmonics, 0.03, 0.002);
  EXPECT_FALSE(found.B.is_known());
}

TEST(Identify, ALateCurrentIsToldAndItsInductanceIsRight) {
  const Identified found = with_effects(
      "\n[[effect]]\nkind = \"signal_lag\"\nsignal = \"current\"\nform = \"delay\"\nlag_s = "
      "5e-5\n");
  EXPECT_TRUE(says(found, "currents: read"));
  EXPECT_NEAR(found.current.lag.value, 5e-5, 5e-6);
  expect_within(found.L_d, 5e-4, 0.01);
}

TEST(SegmentedFit, FindsASharedSlopeBesideFreeOffsetsWithAnHonestSigma) {
  int inside = 0;
  for (std::uint64_t draw = 0; draw < 60; ++draw) {
    SegmentedFit fit(1);
    for (std::uint64_t s = 0; s < 10; ++s) {
      Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(20, 0, 1), y(20);
      for (Eigen::Index k = 0; k < 20; ++k)
        y[k] = static_cast<double>(s) + 3 * t[k] +
               0.1 * normal(draw, s, static_cast<std::uint64_t>(k));
      fit.add(Eigen::MatrixXd::Ones(20, 1), t, y);
    }
    const auto solution = fit.solve({0});
    EXPECT_NEAR(solution.rms, 0.1, 0.03);
    if (std::abs(solution.x[0] - 3) < 2 * solution.sigma[0]) ++inside;
  }
  EXPECT_GE(inside, 48);  // of 60; 57 expected, Student's t with 9 degrees of freedom 55
}

}  // namespace
}  // namespace twinrate::test

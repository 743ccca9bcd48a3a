// Checked means runnable: what cannot run is refused, and what theory expects to be lost is warned
// of.
#include "loop/runnable.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "controller/controller.hpp"
#include "core/field_list.hpp"
#include "loop/load_drive.hpp"
#include "model/machine.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test {
namespace {

std::vector<std::string> checked(const std::string& preset, const Overrides& overrides) {
  Config config = load_drive(preset, overrides);
  return texts_of(check_runnable(config));
}

std::string refusal(const std::string& preset, const Overrides& overrides) {
  try {
    checked(preset, overrides);
  } catch (const BadInput& error) {
    return error.what();
  }
  return "";
}

bool warns(const std::string& preset, const Overrides& overrides, const std::string& of) {
  for (const std::string& warning : checked(preset, overrides))
    if (warning.find("may lose synchronism") != std::string::npos &&
        warning.find(of) != std::string::npos)
      return true;
  return false;
}

TEST(Runnable, ThePresetsRunWithoutAWarning) {
  for (const char* preset : {"dilys2021", "niewiara2020", "kim-ipmsm"})
    EXPECT_TRUE(checked(preset, {}).empty()) << preset;
}

TEST(Runnable, ACopyOfAPresetIsTakenAsThePresetIs) {
  const std::filesystem::path copy =
      std::filesystem::path(testing::TempDir()) / fmt::format("twinrate-copy-{}.toml", getpid());
  for (const std::string& preset : preset_names()) {
    std::filesystem::copy_file(preset_directory() + "/" + preset + ".toml", copy,
                               std::filesystem::copy_options::overwrite_existing);
    EXPECT_EQ(refusal(copy.string(), {}), "") << preset;
  }
  std::ofstream(copy) << "preset = \"dilys2021\"\n"
                         "[controller.foc.startup]\nacceleration_rad_s2 = 321\n";
  EXPECT_NE(refusal(copy.string(), {}).find("acceleration_rad_s2: has no effect here"),
            std::string::npos);
  std::filesystem::remove(copy);
}

// Defaults follow from the machine by formulas, which know no range of a key.
TEST(Runnable, ADriveFileThatIsTakenIsTakenResolvedToo) {
  const std::string own =
      "[machine]\nR_s_Ohm = 0.208\nL_d_H = 3.8e-4\nL_q_H = 4.3e-4\npsi_f_Wb = 0.0197\nn_p = 4\n"
      "B_Nms = 3.6e-5\ni_rated_A = 5.3\nT_rated_Nm = 0.63\nomega_m_rated_rad_s = 168.0\n";
  for (const char* J : {"J_kgm2 = 0.1", "J_kgm2 = 1e-8"}) {
    Config config =
        Config::parse(own + J + "\n[inverter]\nv_dc_V = 48.0\n[rates]\nf_s_Hz = 6800.0\n", J);
    read_all_tables(config);
    Config resolved = Config::parse(config.resolved(), J);
    EXPECT_NO_THROW(read_all_tables(resolved)) << J;
  }
}

TEST(Runnable, AKeyThatNoPartReadsIsRefusedByName) {
  EXPECT_EQ(refusal("dilys2021", {"controller.compensation=load"}),
            "--set: controller.compensation: has no effect here; it is read with an estimator.kind "
            "that estimates the load, ekf_sensorless does not");
  for (const char* kind : {"ekf_joint", "ekf_disturbance", "ekf_harmonic"})
    EXPECT_EQ(refusal("dilys2021",
                      {std::string("estimator.kind=") + kind, "controller.compensation=load"}),
              "")
        << kind;
  for (const auto& [preset, key] :
       {std::pair("kim-ipmsm", "estimator.covariance=sequential"),
        std::pair("dilys2021", "controller.foc.startup.t_align_s=0.2"),
        std::pair("dilys2021", "estimator.dq_ekf.R=1e-3"),
        std::pair("niewiara2020", "controller.lqr.Q_d=[1.0, 2.0]"),
        std::pair("dilys2021", "gain.speed_span_rad_s=100"),
        std::pair("dilys2021", "controller.foc.synchronism.nis_limit=5"),
        std::pair("dilys2021", "inverter.f_pwm_Hz=10000")}) {
    const std::string name = std::string(key).substr(0, std::string(key).find('='));
    EXPECT_NE(refusal(preset, {key}).find(name), std::string::npos) << key;
  }
  EXPECT_EQ(refusal("dilys2021", {"start=align_if", "controller.foc.startup.t_align_s=0.2"}), "");
  const Overrides pair{"estimator.kind=ekf_joint", "estimator.ekf_joint.Q_order_Nm2=1"};
  EXPECT_NE(refusal("dilys2021", pair).find("order above 0"), std::string::npos);
  EXPECT_EQ(refusal("dilys2021", {pair[0], pair[1], "estimator.ekf_joint.order=6"}), "");
}

TEST(Runnable, TheWatchIsRefusedWhereAnAngleIsMeasured) {
  const Overrides watch{"controller.lqr.synchronism.watch=true"};
  EXPECT_NE(refusal("niewiara2020", watch).find("an estimator.kind that estimates the angle"),
            std::string::npos);
  EXPECT_EQ(refusal("niewiara2020", {watch[0], "estimator.kind=ekf_joint"}), "");
  const Overrides stop{"controller.foc.synchronism.watch=true",
                       "controller.foc.synchronism.reaction=stop"};
  EXPECT_EQ(refusal("dilys2021", {stop[0], stop[1], "controller.foc.startup.t_align_s=0.2"}), "");
  EXPECT_NE(refusal("dilys2021", {stop[0], stop[1], "controller.foc.startup.t_agree_s=0.1"})
                .find("start = align_if"),
            std::string::npos);
}

TEST(Runnable, ASteeredValueFromTheStartOnIsRefused) {
  for (const char* set : {"steering.n=7", "steering.policy=rotate"})
    EXPECT_NE(refusal("dilys2021", {set}).find("changes after 0 s allowed"), std::string::npos);
  EXPECT_EQ(refusal("dilys2021", {"steering.n=[[0, 0], [0.5, 7]]"}), "");
}

TEST(Runnable, CompensationIsRefusedWhereNoPartCanDoIt) {
  EXPECT_EQ(refusal("niewiara2020", {"controller.kind=foc", "controller.compensation=load"}), "");
  EXPECT_NE(refusal("niewiara2020", {"controller.kind=foc", "controller.compensation=angle_domain"})
                .find("controller.kind = lqr"),
            std::string::npos);
  EXPECT_EQ(refusal("niewiara2020", {"controller.compensation=angle_domain"}), "");
  EXPECT_NE(refusal("niewiara2020",
                    {"controller.compensation=angle_domain", "estimator.kind=ekf_sensorless"})
                .find("a measured angle"),
            std::string::npos);
}

TEST(Runnable, ARealDriveMayOnlyDoWhatItsProtocolCan) {
  const auto with_bridge = [](Overrides more) {
    more.push_back("plant.kind=bridge");
    return more;
  };
  EXPECT_EQ(refusal("dilys2021", with_bridge({"bridge.port=/dev/ttyACM0"})), "");
  EXPECT_NE(refusal("dilys2021", {"bridge.port=/dev/ttyACM0"}).find("plant.kind = bridge"),
            std::string::npos);
  EXPECT_NE(refusal("dilys2021", with_bridge({"controller.angle_source=truth"})).find("measured"),
            std::string::npos);
  EXPECT_NE(refusal("dilys2021", with_bridge({"bridge.protocol=vesc"})).find("listen allowed"),
            std::string::npos);
  EXPECT_EQ(refusal("dilys2021", with_bridge({"bridge.protocol=vesc", "bridge.mode=listen"})), "");
}

TEST(Runnable, KeysOfAnotherProtocolOrLineAreRefused) {
  const auto with_bridge = [](Overrides more) {
    more.push_back("plant.kind=bridge");
    return refusal("dilys2021", more);
  };
  EXPECT_NE(with_bridge({"bridge.moteus_id=3"}).find("bridge.protocol = moteus"),
            std::string::npos);
  EXPECT_EQ(with_bridge({"bridge.moteus_id=3", "bridge.protocol=moteus"}), "");
  EXPECT_NE(with_bridge({"bridge.theta_e_offset_rad=1"}).find("moteus or vesc"), std::string::npos);
  EXPECT_NE(with_bridge({"bridge.float64=false", "bridge.protocol=moteus"}).find("twinrate"),
            std::string::npos);
  EXPECT_NE(with_bridge({"bridge.baud=115200", "bridge.port=udp://h:1"}).find("serial"),
            std::string::npos);
  EXPECT_NE(with_bridge({"bridge.without_watchdog=true"}).find("moteus_control = voltage"),
            std::string::npos);
}

TEST(Runnable, KeysThatARealDriveDoesNotReadAreNamed) {
  const Overrides bridge = {"plant.kind=bridge", "bridge.port=udp://h:1", "plant.engine=erk"};
  Config control = load_drive("dilys2021", bridge);
  const auto list = texts_of(check_runnable(control));
  ASSERT_EQ(list.size(), 1u);
  EXPECT_NE(list[0].find("unused keys"), std::string::npos) << list[0];
  EXPECT_NE(list[0].find("plant.engine"), std::string::npos) << list[0];
  EXPECT_EQ(list[0].find("plant.kind"), std::string::npos) << list[0];
  Overrides listen = {"plant.kind=bridge", "bridge.mode=listen", "controller.foc.i_max_A=2"};
  Config listened = load_drive("dilys2021", listen);
  EXPECT_NE(check_runnable(listened).at(0).text.find("controller.foc.i_max_A"), std::string::npos);
  Config emulated =
      load_drive("dilys2021", {"plant.kind=bridge", "bridge.emulate=true", "plant.engine=erk"});
  EXPECT_TRUE(check_runnable(emulated).empty());
}

TEST(Runnable, WarnsOfALeaseShorterThanTheLinkCanHold) {
  const auto warning = [](Overrides more) -> std::string {
    more.push_back("plant.kind=bridge");
    const auto list = checked("dilys2021", more);
    return list.empty() ? "" : list[0];
  };
  EXPECT_NE(warning({"bridge.lease_ms=3"}).find("p99.9"), std::string::npos);
  EXPECT_NE(warning({"bridge.lease_ms=3", "bridge.baud=115200"}).find("shorter than the link"),
            std::string::npos);
  EXPECT_EQ(warning({}), "");
  EXPECT_EQ(warning({"bridge.lease_ms=3", "bridge.mode=listen"}).find("p99.9"), std::string::npos);
}

TEST(Runnable, WarnsOfALineThatCannotCarryTheSamplesAndOfOnesWithoutVoltage) {
  const Overrides serial = {"plant.kind=bridge", "bridge.port=/dev/ttyUSB0"};
  const auto warnings = [&](Overrides more) {
    more.insert(more.end(), serial.begin(), serial.end());
    return fmt::format("{}", checked("dilys2021", more));
  };
  EXPECT_NE(warnings({}).find("0.42 ms on the line, a tick 0.2 ms"), std::string::npos);
  EXPECT_EQ(warnings({"rates.f_s_Hz=2000"}).find("on the line"), std::string::npos);
  EXPECT_NE(warnings({"bridge.mode=listen", "bridge.protocol=moteus", "bridge.moteus_listen=uart",
                      "rates.f_s_Hz=2000"})
                .find("tells no voltage"),
            std::string::npos);
}

TEST(Runnable, AModeWithoutADeviceWatchdogIsNotCalledSafe) {
  Overrides voltage = {"plant.kind=bridge", "bridge.protocol=moteus",
                       "bridge.moteus_control=voltage"};
  EXPECT_NE(refusal("dilys2021", voltage).find("without_watchdog"), std::string::npos);
  voltage.push_back("bridge.without_watchdog=true");
  Config config = load_drive("dilys2021", voltage);
  const auto list = texts_of(check_runnable(config));
  ASSERT_EQ(list.size(), 1u);
  EXPECT_NE(list[0].find("not safe"), std::string::npos) << list[0];
  Config torque = load_drive("dilys2021", {"plant.kind=bridge", "bridge.protocol=moteus"});
  EXPECT_TRUE(check_runnable(torque).empty());
}

TEST(Runnable, AResolvedFileRunsThoughItHoldsEveryKey) {
  const Config config = load("dilys2021", {});
  EXPECT_NE(config.resolved().find("# resolved by twinrate"), std::string::npos);
}

// L = -700 Nm/rad belongs to 8.8e-3 kgm2: -J f_s^2 is -250 on the rotor of dilys2021.
TEST(Runnable, AnIntegralGainOfAnotherMotorIsRefused) {
  const Overrides other{"estimator.kind=ekf_disturbance"};
  EXPECT_EQ(refusal("dilys2021", other), "") << "the default fits the machine";
  EXPECT_NE(refusal("dilys2021",
                    {"estimator.kind=ekf_disturbance", "estimator.ekf_disturbance.L_Nm_rad=-700"})
                .find("-250 to 0 allowed"),
            std::string::npos);
}

// The measured limits are n = 12 (docs/find-fbmin.md), and 4 of `eemf` at 66.7 Hz and 10 kHz.
TEST(Runnable, WarnsBeyondTheLargestNThatTheoryHolds) {
  EXPECT_FALSE(warns("dilys2021", {"rates.n=12"}, "n = 12"));
  EXPECT_TRUE(warns("dilys2021", {"rates.n=13"}, "n = 12"));
  EXPECT_FALSE(warns("dilys2021", {"rates.n=12", "controller.kind=lqr"}, "holds up"));
  EXPECT_TRUE(warns("dilys2021", {"rates.n=14", "controller.kind=lqr"}, "n = 12"));
  const Overrides eemf{"estimator.kind=eemf", "start=flying", "rates.n=4"};
  EXPECT_FALSE(warns("kim-ipmsm", eemf, "rates.n"));
  EXPECT_TRUE(warns("kim-ipmsm", {eemf[0], eemf[1], "rates.n=5"}, "n = 4"));
  EXPECT_FALSE(warns("dilys2021", {"rates.n=100", "gain.policy=rotate"}, "rates.n"));
  EXPECT_FALSE(warns("kim-ipmsm", {"rates.n=20"}, "rates.n")) << "dq_ekf works in rotor axes";
}

TEST(Runnable, WarnsOfASpeedAtWhichASensorlessFilterSeesNothing) {
  EXPECT_TRUE(warns("niewiara2020", {"estimator.kind=dq_ekf"}, "EMF"));
  EXPECT_FALSE(warns("niewiara2020", {"estimator.kind=dq_ekf", "reference.speed_rpm=500"}, "EMF"));
  EXPECT_FALSE(warns("niewiara2020", {}, "EMF")) << "it has a position sensor";
}

// 4.6 V are uncertain: 1.5 V by R_s, the rest by a dead time that the filter does not know.
TEST(Runnable, WarnsOfASpeedAtWhichTheLoadIsNotObservable) {
  const std::string joint = "estimator.kind=ekf_joint";
  EXPECT_TRUE(warns("niewiara2020", {joint, "reference.speed_rpm=60"}, "load is not observable"));
  EXPECT_FALSE(warns("niewiara2020", {joint, "reference.speed_rpm=100"}, "load is not observable"));
}

TEST(Runnable, WarnsOfAFilterOutsideItsStatedLimits) {
  EXPECT_TRUE(warns("kim-ipmsm", {"estimator.kind=backemf_printed"}, "saliency"));
  EXPECT_FALSE(warns("kim-ipmsm", {"estimator.kind=backemf_printed", "plant.saliency=fixed_axes"},
                     "saliency"));
  const Overrides slow{"estimator.kind=active_flux", "start=flying",
                       "controller.foc.speed_bandwidth_Hz=15"};
  EXPECT_FALSE(warns("kim-ipmsm", slow, "speed loop"));
  EXPECT_TRUE(warns("kim-ipmsm", {slow[0], slow[1]}, "speed loop"));
}

// A lost drive of f_s = 1 kHz ended in an error of the engine with one step a tick, R_s T_s/L = 2.5.
TEST(Runnable, RefusesFixedStepsThatAreLongerThanTheWindingAllows) {
  const Overrides erk{"plant.engine=erk", "plant.erk_steps=1"};
  EXPECT_NE(refusal("laas_mn4004", erk).find("at least 2 allowed"), std::string::npos);
  EXPECT_EQ(refusal("laas_mn4004", {erk[0], "plant.erk_steps=2"}), "");
  EXPECT_EQ(refusal("dilys2021", erk), "");
}

// A bound for a state feedback of f_s/40 = 250 Hz, where the closed loop has no analysis: the salient rotor
// of backemf_printed. dq_ekf is covered and holds n = 20.
TEST(Runnable, WarnsOfStateFeedbackFasterThanHalfTheRateOfTheGains) {
  const std::string lqr = "controller.kind=lqr", printed = "estimator.kind=backemf_printed";
  const auto at = [&](const char* n, const std::string& filter) {
    return warns("kim-ipmsm", {lqr, "start=flying", n, filter}, "the gains come at 500 Hz");
  };
  EXPECT_TRUE(at("rates.n=20", printed));
  EXPECT_FALSE(at("rates.n=10", printed));
  EXPECT_FALSE(at("rates.n=20", "estimator.kind=dq_ekf"));
}

// bench/pairings --random 60, machine 8: lost with a speed loop of 15 Hz, also at n = 1.
TEST(Runnable, WarnsOfASpeedLoopFasterThanItsFilter) {
  const Overrides machine = {"machine.R_s_Ohm=0.026",
                             "machine.L_d_H=317e-6",
                             "machine.L_q_H=317e-6",
                             "machine.psi_f_Wb=0.041",
                             "machine.n_p=3",
                             "machine.J_kgm2=1.82e-3",
                             "machine.B_Nms=3.5e-4",
                             "machine.i_rated_A=24.3",
                             "machine.T_rated_Nm=4.47",
                             "machine.omega_m_rated_rad_s=50.4",
                             "inverter.v_dc_V=15.05",
                             "rates.f_s_Hz=8979",
                             "reference.speed_rpm=233.5",
                             "start=flying",
                             "load.T_load_Nm=0.5",
                             "estimator.kind=eemf",
                             "estimator.eemf.Q_diag=[9.9e-3, 9.9e-3, 1.3e-3, 1.3e-3, 0.115]",
                             "estimator.eemf.R_diag=[0.098, 0.098]"};
  Overrides fast = machine, slow = machine;
  fast.emplace_back("controller.foc.speed_bandwidth_Hz=15.5");
  slow.emplace_back("controller.foc.speed_bandwidth_Hz=0.5");
  EXPECT_TRUE(warns("kim-ipmsm", fast, "follows the speed at"));
  EXPECT_FALSE(warns("kim-ipmsm", slow, "follows the speed at"));
}

bool says(const std::string& preset, const Overrides& overrides, const std::string& of) {
  for (const std::string& warning : checked(preset, overrides))
    if (warning.find(of) != std::string::npos) return true;
  return false;
}

// dilys2021: alignment and ramp take 0.77 s.
TEST(Runnable, SaysWhatDisturbsAStartByAlignment) {
  const Overrides start{"start=align_if", "run.duration_s=2"};
  EXPECT_TRUE(checked("dilys2021", start).empty());
  EXPECT_TRUE(says("dilys2021", {start[0], "run.duration_s=0.7"}, "alignment and ramp take"));
  const std::string key = "load.T_load_Nm=[[0.0, 0.0], [";
  for (const auto& [t, disturbs] : {std::pair("0.65", true), std::pair("0.58", true),
                                    std::pair("0.2", false), std::pair("1.0", false)})
    EXPECT_EQ(says("dilys2021", {start[0], start[1], "load.slew_Nm_s=0", key + t + ", 0.05]]"},
                   "during alignment or I/f ramp"),
              disturbs)
        << t;
}

TEST(Runnable, WarnsOfAHandOverBelowTheLowPassOfTheSpeed) {
  const Overrides slow{"estimator.kind=active_flux", "start=align_if",
                       "controller.foc.speed_bandwidth_Hz=15",
                       "controller.foc.startup.omega_e_handover_rad_s=40"};
  EXPECT_TRUE(warns("kim-ipmsm", slow, "hand-over comes at 6.37 Hz"));
  EXPECT_FALSE(warns("kim-ipmsm", {slow[0], slow[1], slow[2]}, "hand-over"));
}

double t_align_of(const Overrides& overrides) {
  const auto builder = controller_builder("foc", drive_of("dilys2021", overrides));
  for (const FieldRow& row : list_fields([&](FieldVisitor& f) { builder->fields(f); }))
    if (row.key == "startup.t_align_s") return row.value;
  return 0;
}

// By hand: k 32.25 Nm/rad, at rest D 3.516 Nms, overdamped, slower root 9.67 1/s.
TEST(ScaledStart, AlignsUntilTheRotorHasSettled) {
  EXPECT_EQ(t_align_of({}), 0.3);
  EXPECT_NEAR(
      t_align_of({"machine.R_s_Ohm=0.326508", "machine.L_d_H=6.57448e-3",
                  "machine.L_q_H=6.57448e-3", "machine.psi_f_Wb=6.72909e-2", "machine.n_p=13",
                  "machine.J_kgm2=1.85093e-2", "machine.i_rated_A=1.26055"}),
      5 / 9.67, 0.002);
}

// The stiffness is the slope of the machine's own torque over the angle between current and magnet;
// with L_q > L_d the reluctance takes 0.37 of it.
TEST(ScaledStart, ReluctanceTakesFromTheStiffnessOfASalientRotor) {
  constexpr double kTurn = 1e-6;  // rad, electrical
  const MachineParameters m{.R_s = 0.326508,
                            .L_d = 6.57448e-3,
                            .L_q = 19.72e-3,
                            .psi_f = 6.72909e-2,
                            .J = 4e-2,
                            .n_p = 13};
  const double i = 1.5 * 1.26055, flux = m.n_p * m.psi_f;
  const double k = m.n_p * m.torque(i * std::cos(kTurn), i * std::sin(kTurn)) / kTurn;
  const double damping = 1.5 * flux * flux * m.R_s / (m.R_s * m.R_s + k / m.J * m.L_q * m.L_q);
  ASSERT_LT(damping * damping, 4 * m.J * k);  // it swings
  EXPECT_NEAR(t_align_of({"machine.R_s_Ohm=0.326508", "machine.L_d_H=6.57448e-3",
                          "machine.L_q_H=19.72e-3", "machine.psi_f_Wb=6.72909e-2", "machine.n_p=13",
                          "machine.J_kgm2=4e-2", "machine.i_rated_A=1.26055"}),
              5 / (damping / (2 * m.J)), 0.002);
}

TEST(Runnable, TakesNoTableOverSpeed) {
  const auto begun = std::chrono::steady_clock::now();
  checked("niewiara2020", {"estimator.kind=ekf_harmonic", "gain.policy=scheduled"});
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));
}

}  // namespace
}  // namespace twinrate::test

// Errors before and after, on simulated logs with known effects.
#include "verify/verify.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "tests/support/drives.hpp"
#include "trace/measured.hpp"

namespace twinrate {
namespace {

const test::Overrides kShort = {"controller.kind=foc",
                                "controller.compensation=off",
                                "controller.angle_source=measured",
                                "controller.foc.compensate_effects=true",
                                "reference.speed_rpm=[[0, 60], [0.8, 150]]",
                                "reference.slew_rad_s2=300.0",
                                "load.T_load_Nm=1.5",
                                "run.duration_s=1.6",
                                "run.settle_s=0.4"};

Config drive_with(const std::string& effects, int current_sensors = 3) {
  test::Overrides overrides = kShort;
  overrides.push_back("effect=[" + effects + "]");
  overrides.push_back("sensors.current_sensors=" + std::to_string(current_sensors));
  Config config = load_drive("niewiara2020", overrides);
  return config;
}

const std::string kCogging =
    "{kind=\"cogging\", order=12, amplitude_Nm=0.15, phase_rad=0.4, used_in=\"both\"}";
const std::string kDeadTime = "{kind=\"dead_time\", dead_time_s=3e-6, used_in=\"both\"}";

// A simulated log of a drive; every row is held out.
VerifyLog log_of(const std::string& effects, int current_sensors = 3) {
  Config config = drive_with(effects, current_sensors);
  ClosedLoop loop(config);
  VerifyLog log;
  std::deque<MeasuredRow> rows;
  while (loop.k() < config.drive().steps()) {
    const TickRecord& tick = loop.step();
    log.measurements.push_back(tick.measurement);
    rows.push_back({tick.measurement, 1.5});
  }
  Health health;
  log.record = make_record(raw_log_of(rows, 0, rows.size()), config.drive().machine.n_p, health);
  log.held_out.assign(log.record.size(), 1);
  return log;
}

TEST(Verify, TheFreeRunShowsCoggingUntilTheModelHasIt) {
  Config declared = drive_with(""), extended = drive_with(kCogging);
  const ModelError e = model_error({log_of(kCogging)}, declared, extended, 0.2, 5e-3);
  EXPECT_GE(e.runs, 5u);
  EXPECT_GT(e.omega_m.before, 0.1);
  EXPECT_LT(e.omega_m.after, 0.2 * e.omega_m.before);
  EXPECT_GT(e.omega_m.after, 0);
}

TEST(Verify, OneStepShowsDeadTimeInTheCurrents) {
  Config declared = drive_with(""), extended = drive_with(kDeadTime);
  const ModelError e = model_error({log_of(kDeadTime)}, declared, extended, 0, 5e-3);
  EXPECT_GT(e.runs, 100u);
  // About 4/pi 7 V of lost voltage over 100 us and 12.7 mH, against noise of 0.008 A a sample.
  EXPECT_GT(e.i_q.before, 0.03);
  EXPECT_LT(e.i_q.after, 0.6 * e.i_q.before);
  EXPECT_GT(e.i_q.after, 0.005);
}

TEST(Verify, ACompleteModelDoesNotImprove) {
  Config declared = drive_with("");
  const ModelError e = model_error({log_of("")}, declared, declared, 0.2, 5e-3);
  EXPECT_EQ(e.i_d.before, e.i_d.after);
  EXPECT_EQ(e.omega_m.before, e.omega_m.after);
  EXPECT_LT(e.omega_m.after, 0.1);
}

TEST(Verify, OneStepShowsAShaftInTheSpeed) {
  // 28 Hz, damped by 4 %: the load oscillates long after each change of speed.
  const std::string torsion =
      "{kind=\"torsion\", J_load_kgm2=2.8e-3, stiffness_Nm_rad=60, damping_Nms_rad=0.03, "
      "used_in=\"both\"}";
  Config declared = drive_with(""), extended = drive_with(torsion);
  const ModelError e = model_error({log_of(torsion)}, declared, extended, 0, 5e-3);
  EXPECT_LT(e.omega_m.after, 0.5 * e.omega_m.before);
  EXPECT_GT(e.omega_m.after, 0);
}

std::string late_by(const char* signal, const char* form, double lag_s) {
  return fmt::format(
      "{{kind=\"signal_lag\", signal=\"{}\", form=\"{}\", lag_s={}, used_in=\"both\"}}", signal,
      form, lag_s);
}

TEST(Verify, OneStepShowsAVoltageDelayInTheCurrents) {
  for (const char* form : {"delay", "first_order"}) {
    const std::string late = late_by("voltage", form, 250e-6);
    Config declared = drive_with(""), extended = drive_with(late);
    const VerifyLog log = log_of(late);
    const ModelError step = model_error({log}, declared, extended, 0, 5e-3);
    const ModelError run = model_error({log}, declared, extended, 0.2, 5e-3);
    EXPECT_LT(step.i_d.after, 0.99 * step.i_d.before) << form;
    EXPECT_LT(run.i_d.after, 0.5 * run.i_d.before) << form;
    EXPECT_GT(run.i_d.after, 0.003) << form;
  }
}

TEST(Verify, AFreeRunKeepsTheDelayOfAReading) {
  for (const char* signal : {"current", "angle"})
    for (const double lag_s : {50e-6, 830e-6}) {
      const std::string late = late_by(signal, "delay", lag_s);
      Config declared = drive_with(""), extended = drive_with(late);
      const VerifyLog log = log_of(late);
      const ModelError step = model_error({log}, declared, extended, 0, 5e-3);
      const ModelError run = model_error({log}, declared, extended, 0.2, 5e-3);
      for (const ModelError& e : {step, run}) {
        EXPECT_LT(e.i_d.after, 1.02 * e.i_d.before) << signal << lag_s;
        EXPECT_LT(e.i_q.after, 1.02 * e.i_q.before) << signal << lag_s;
      }
      if (lag_s > 1e-4) {
        EXPECT_LT(run.i_d.after, 0.7 * run.i_d.before) << signal << lag_s;
      }
    }
}

TEST(Verify, WithTwoSensorsTheOffsetOfTheThirdCurrentIsThatOfTheOthers) {
  const std::string offset =
      "{kind=\"current_offset\", offset_a_A=0.18, offset_b_A=-0.03, used_in=\"both\"}";
  const VerifyLog log = log_of(offset, 2);
  ASSERT_EQ(log.record.current_sensors, 2);
  for (const int in_the_drive_file : {2, 3}) {
    Config declared = drive_with("", in_the_drive_file),
           extended = drive_with(offset, in_the_drive_file);
    const ModelError step = model_error({log}, declared, extended, 0, 5e-3);
    const ModelError run = model_error({log}, declared, extended, 0.2, 5e-3);
    EXPECT_LT(step.i_d.after, 1.02 * step.i_d.before);
    EXPECT_LT(run.i_d.after, 0.2 * run.i_d.before);
    EXPECT_LT(run.i_q.after, 0.2 * run.i_q.before);
  }
}

TEST(Verify, ReportsErrorsThatRiseAndLevelsWithoutChange) {
  Verification v;
  v.speed_horizon_s = 5e-3;
  v.window_s = 0.2;
  v.one_step = ModelError{{1, 1.04}, {1, 0.5}, {1, 4.3}};
  v.free_run = ModelError{{1, 1.0001}, {1, 1}, {0, 0}};
  const std::vector<std::string> lines = remarks(v);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0], "worse with the extended model: one step omega_m over 5 ms x 4.300");
  EXPECT_EQ(lines[1], "no change with the extended model (x 1.000): free run");
  EXPECT_NE(table(v).find(lines[0]), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(to_json(v))["remarks"][1], lines[1]);
  EXPECT_EQ(table(v).find("simulated"), std::string::npos);
  v.closed_loop = LoopError{{1, 0.5}, {1, 0.5}, {1, 0.5}};
  EXPECT_LT(table(v).find("simulated, no held-out data"), table(v).find("closed loop"));
  v.closed_loop.reset();
  v.one_step = v.free_run = ModelError{{1, 0.9}, {1, 1.04}, {1, 1}};
  EXPECT_TRUE(remarks(v).empty());
}

TEST(Verify, TrainingRowsAreNotUsed) {
  VerifyLog log = log_of("");
  std::fill(log.held_out.begin(), log.held_out.begin() + 12000, 0);
  Config declared = drive_with("");
  EXPECT_LE(model_error({log}, declared, declared, 0.2, 5e-3).runs, 2u);
}

// Held out: 0.5 s to 0.9 s. What is read later is training; what was read before it made the state.
TEST(Verify, TheEstimatorIsJudgedOnHeldOutRowsAlone) {
  VerifyLog log = log_of("");
  const auto row = [&](double t) { return static_cast<std::size_t>(t / log.record.T_s); };
  std::fill(log.held_out.begin(), log.held_out.end(), 0);
  std::fill(log.held_out.begin() + static_cast<std::ptrdiff_t>(row(0.5)),
            log.held_out.begin() + static_cast<std::ptrdiff_t>(row(0.9)), 1);
  Config declared = drive_with(""), extended = drive_with(kCogging);
  const VerifySettings here{.over_lcm = false};
  const EstimatorError plain = estimator_error({log}, declared, extended, here);
  EXPECT_NEAR(static_cast<double>(plain.ticks), 0.4 / log.record.T_s, 2);
  const auto shaken = [&](double from, double to) {
    VerifyLog other = log;
    for (std::size_t n = row(from); n < row(to); ++n)
      other.measurements[n].omega_m += n % 2 == 0 ? 0.5 : -0.5;
    return estimator_error({other}, declared, extended, here).innovation[2];
  };
  const BeforeAfter after_it = shaken(0.95, 1.5), in_it = shaken(0.5, 0.9);
  EXPECT_EQ(after_it.before, plain.innovation[2].before);
  EXPECT_EQ(after_it.after, plain.innovation[2].after);
  EXPECT_GT(in_it.before, plain.innovation[2].before + 0.1);
  EXPECT_GT(in_it.after, plain.innovation[2].after + 0.1);
}

// A start of the estimator that is held out does not count: it finds its state first.
TEST(Verify, TheEstimatorsFirstThirdOfASecondDoesNotCount) {
  const VerifyLog log = log_of("");
  Config declared = drive_with("");
  const EstimatorError all = estimator_error({log}, declared, declared, {.over_lcm = false});
  EXPECT_NEAR(static_cast<double>(all.ticks), 1.3 / log.record.T_s, 3);
}

TEST(Verify, TheExtendedEstimatorHasSmallerInnovationsAndTheLoopLessRipple) {
  Config declared = drive_with(""), extended = drive_with(kCogging);
  VerifySettings settings;
  settings.over_lcm = false;
  const Verification v = verify({log_of(kCogging)}, declared, extended, settings);
  ASSERT_TRUE(v.estimator && v.closed_loop && v.free_run && v.one_step);
  ASSERT_EQ(v.estimator->innovation.size(), 3u);
  EXPECT_LT(v.estimator->innovation[2].after, v.estimator->innovation[2].before);
  EXPECT_LT(v.closed_loop->speed_ripple.after, v.closed_loop->speed_ripple.before);
  const auto json = nlohmann::json::parse(to_json(v));
  EXPECT_EQ(json["estimator"]["over"], "in_process");
  EXPECT_EQ(json["closed_loop"]["speed_ripple_rms_rad_s"]["after"],
            v.closed_loop->speed_ripple.after);
  EXPECT_NE(table(v).find("free run"), std::string::npos);
}

}  // namespace
}  // namespace twinrate

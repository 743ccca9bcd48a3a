// The monitor in one process with a simulated drive whose plant changes during the run.
#include "monitor/live_monitor.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

// Varying speed and load, so that the effects are identifiable.
const char* const kDrive = R"(
[controller]
kind = "foc"
angle_source = "measured"
[controller.foc]
compensate_effects = true
speed_bandwidth_Hz = 15.0
[reference]
speed_rpm = [[0, 150], [0.5, 250], [1, 200], [1.5, 300], [2, 150], [2.5, 250], [3, 200], [3.5, 300], [4, 150], [4.5, 250], [5, 200], [5.5, 300], [6, 150]]
slew_rad_s2 = 300.0
[load]
T_load_Nm = [[0, 1], [0.25, 1], [0.75, 2.5], [1.25, 1.5], [1.75, 3], [2.25, 1], [2.75, 2.5], [3.25, 1.5], [3.75, 3], [4.25, 1], [4.75, 2.5], [5.25, 1.5], [5.75, 3], [6.25, 1]]
slew_Nm_s = 15.0
[run]
duration_s = 6.5
settle_s = 0.5
[monitor]
auto_add = true
gather_s = 1.5
)";

std::shared_ptr<const Effect> effect_of(const std::string& kind) {
  Config config = Config::parse("preset = \"niewiara2020\"\n[[effect]]\nkind = \"" + kind +
                                    "\"\nused_in = \"model\"\ntorque_Nm = 0.2\n",
                                "one");
  return config.drive().effects.back().effect;
}

struct Outcome {
  std::vector<MonitorNotice> notices;
  std::vector<Episode> episodes;
  std::size_t model_effects = 0;  // at the end
};

const char* const kDeadTime =
    "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 2e-6\nfrom_s = 3.0\n";

struct Circumstances {
  std::vector<std::string> overrides;
  std::function<TraceResult(const TraceJob&)> tracer = [](const TraceJob& job) { return run(job); };
  bool angle = true;     // measured
  double outlier_V = 0;  // in the voltage read from 3.1 to 3.2 s and from 5.1 to 5.2 s
};

// Runs the drive with its monitor and adds the proposed effects.
Outcome watch(const std::string& effects, const Circumstances& with = {}) {
  const std::string none = effects.empty() ? "effect = []\n" : "";
  Config config = Config::parse("preset = \"niewiara2020\"\n" + none + kDrive + effects, "live",
                                with.overrides);
  read_all_tables(config);
  ClosedLoop loop(config);
  LiveMonitor monitor(config);
  std::optional<Config> extended, coming;
  std::int64_t from = 0;
  bool adding = true;
  Outcome outcome;
  while (loop.k() < config.drive().steps()) {
    const TickRecord& tick = loop.step();
    Measurement m = tick.measurement;
    if (!with.angle) m.signals &= ~kPosition;
    const double t_s = 1e-9 * static_cast<double>(m.t_ns);
    if ((t_s > 3.1 && t_s < 3.2) || (t_s > 5.1 && t_s < 5.2)) m.u_alphabeta[0] += with.outlier_V;
    monitor.take(m);
    monitor.take(tick.estimate);
    while (const auto job = monitor.take_job()) monitor.traced(with.tracer(*job));
    const Config& present = extended ? *extended : config;
    if (const auto toml = monitor.take_addition()) {
      coming = present.with_effects(*toml, "test");
      adding = true;
      from = monitor.tick_for_request();
    }
    if (const auto toml = monitor.take_removal()) {
      coming = present.without_effects(*toml, "test", config.drive().effects.size());
      adding = false;
      from = monitor.tick_for_request();
    }
    for (MonitorNotice& notice : monitor.take_notices()) outcome.notices.push_back(notice);
    if (coming && loop.k() >= from) {
      loop.know(*coming);
      extended = std::exchange(coming, {});
      adding ? monitor.added(loop.k()) : monitor.removed(loop.k());
    }
  }
  outcome.episodes = monitor.episodes();
  outcome.model_effects = (extended ? *extended : config).drive().model_effects().size();
  return outcome;
}

// A single block above the level is no misfit of the model, and neither are two that are apart.
TEST(LiveMonitor, ReportsNothingIfTheModelFitsInAllButSingleBlocks) {
  EXPECT_TRUE(watch("", {.overrides = {}, .outlier_V = 20}).notices.empty());
}

TEST(LiveMonitor, ProposesADeadTimeThatStartsDuringTheRun) {
  const Outcome outcome = watch(kDeadTime);
  ASSERT_EQ(outcome.episodes.size(), 1u);
  const Episode& e = outcome.episodes[0];
  EXPECT_GT(e.noticed_s, 3.0);
  EXPECT_LT(e.noticed_s, 3.8);
  EXPECT_EQ(e.kinds, std::vector<std::string>{"dead_time"}) << e.toml;
  EXPECT_GT(e.added_s, e.noticed_s);
  EXPECT_LT(e.after.voltage, 0.3 * e.before.voltage);
  EXPECT_GT(e.before.voltage, 0.5);  // 2 us of 100 us at 235 V, in stator axes
  ASSERT_FALSE(e.innovation_before.empty());
  EXPECT_GT(e.innovation_before[1], 1.2 * e.innovation_after.at(1));
  ASSERT_EQ(outcome.notices.size(), 3u);
  EXPECT_EQ(outcome.notices[0].reason, Reason::kModelMisfit);
  EXPECT_EQ(outcome.notices[1].reason, Reason::kEffectProposed);
  EXPECT_EQ(outcome.notices[2].reason, Reason::kEffectCompared);
  for (const char* untidy : {"  ", " ,"})
    EXPECT_EQ(outcome.notices[2].text.find(untidy), std::string::npos) << outcome.notices[2].text;
}

// Blocks of 0.3 s do not end with the window.
TEST(LiveMonitor, DoublesTheTracedDataUpToTheWindowAndThenReportsNoResult) {
  std::vector<double> lengths_s;
  const Outcome outcome =
      watch(kDeadTime,
            {.overrides = {"monitor.block_s=0.3", "monitor.gather_s=0.5", "monitor.window_s=2.0"},
             .tracer = [&](const TraceJob& job) {
               lengths_s.push_back(job.record.t.back() - job.record.t.front());
               TraceResult nothing;
               nothing.sentence = "Nothing that the catalogue holds.";
               return nothing;
             }});
  ASSERT_EQ(lengths_s.size(), 3u);
  for (const double asked_s : {0.5, 1.0, 2.0}) {
    const double length_s = lengths_s[asked_s < 1 ? 0 : asked_s < 2 ? 1 : 2];
    EXPECT_GT(length_s, asked_s - 0.01);
    EXPECT_LT(length_s, asked_s + 0.31);
  }
  ASSERT_EQ(outcome.notices.size(), 2u);
  EXPECT_EQ(outcome.notices[0].reason, Reason::kModelMisfit);
  EXPECT_EQ(outcome.notices[1].reason, Reason::kNothingTraced);
  EXPECT_EQ(outcome.notices[1].text,
            "Nothing that the catalogue holds. The present residuals are the new reference.");
}

// The innovations alone show that the model does not fit.
TEST(LiveMonitor, WithoutAnAngleReportsThatNothingCanBeTraced) {
  const Outcome outcome = watch(kDeadTime, {.overrides = {}, .angle = false});
  ASSERT_EQ(outcome.notices.size(), 2u);
  EXPECT_EQ(outcome.notices[0].reason, Reason::kModelMisfit);
  EXPECT_EQ(outcome.notices[1].reason, Reason::kNothingTraced);
  EXPECT_EQ(outcome.notices[1].text,
            "Currents and angle are not measured. The present residuals are the new reference.");
}

TEST(LiveMonitor, RestartsWithTheTicksOfAnotherRun) {
  Config config = Config::parse(std::string("preset = \"niewiara2020\"\n") + kDrive, "live");
  LiveMonitor monitor(config);
  monitor.take(Measurement{.k = 100});
  monitor.restart();
  EXPECT_EQ(monitor.last_k(), -1);
  monitor.take(Measurement{.k = 3});
  EXPECT_EQ(monitor.last_k(), 3);
}

// The plant follows the request; the drive file knows nothing of it.
TEST(LiveMonitor, ASteeredLoadIsNoMisfitForAMonitorThatHeardTheRequest) {
  const std::string drive = std::string("preset = \"niewiara2020\"\neffect = []\n") + kDrive;
  Config steered = Config::parse(
      drive, "live",
      {"run.duration_s=4.5",
       "load.T_load_Nm=[[0, 1], [0.75, 2.5], [1.25, 1.5], [1.75, 3], [2.25, 1], [2.99995, 4]]"});
  Config declared =
      Config::parse(drive, "live",
                    {"run.duration_s=4.5",
                     "load.T_load_Nm=[[0, 1], [0.75, 2.5], [1.25, 1.5], [1.75, 3], [2.25, 1]]"});
  read_all_tables(steered);
  ClosedLoop loop(steered);
  LiveMonitor hears(declared), deaf(declared);
  hears.steer(30'000, "speed_rpm=250\nload_Nm=4");
  while (loop.k() < steered.drive().steps()) {
    const TickRecord& tick = loop.step();
    for (LiveMonitor* monitor : {&hears, &deaf}) {
      monitor->take(tick.measurement);
      monitor->take(tick.estimate);
    }
  }
  EXPECT_TRUE(hears.take_notices().empty());
  const std::vector<MonitorNotice> notices = deaf.take_notices();
  ASSERT_EQ(notices.size(), 1u);
  EXPECT_EQ(notices[0].reason, Reason::kModelMisfit);
}

TEST(LiveMonitor, AnAdditionIsAnnouncedATenthOfASecondAhead) {
  Config config = Config::parse(std::string("preset = \"niewiara2020\"\n") + kDrive, "live");
  LiveMonitor monitor(config);
  monitor.take(Measurement{.k = 100});
  EXPECT_EQ(monitor.tick_for_request(), 100 + 1000);  // at 10 kHz
}

// The first traced data contain one of the two effects only in part: the tracer finds a resistance
// that drifts instead of one that is present from 3.3 s on.
TEST(LiveMonitor, GathersAgainUntilTwoEffectsActInAllData) {
  const Outcome outcome = watch(
      "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 2e-6\nfrom_s = 2.6\n"
      "[[effect]]\nkind = \"resistance\"\nchange_Ohm = 0.42\nfrom_s = 3.3\n");
  ASSERT_EQ(outcome.episodes.size(), 1u);
  const Episode& e = outcome.episodes[0];
  EXPECT_EQ(e.kinds, (std::vector<std::string>{"dead_time", "resistance"})) << e.toml;
  const auto effects =
      Config::parse("preset = \"niewiara2020\"\n" + e.toml, "proposed").drive().model_effects();
  ASSERT_EQ(effects.size(), 2u);
  EXPECT_NEAR(get_key(*effects[0], "dead_time_s"), 2e-6, 2e-8);
  EXPECT_NEAR(get_key(*effects[1], "change_Ohm"), 0.42, 0.02);
  EXPECT_GT(e.proposed_s, 5.5);
}

// A misfit of the voltage is "explained" by a friction that the drive does not have.
TEST(LiveMonitor, TakesBackAnEffectThatMakesTheErrorLarger) {
  const Outcome outcome =
      watch(kDeadTime, {.overrides = {"monitor.gather_s=0.5"}, .tracer = [](const TraceJob&) {
                          TraceResult wrong;
                          wrong.verdict = "traced";
                          wrong.sentence = "The model lacks friction.";
                          TracedEffect friction;
                          friction.effect = effect_of("coulomb_friction");
                          wrong.effects.push_back(friction);
                          return wrong;
                        }});
  ASSERT_FALSE(outcome.episodes.empty());
  const Episode& e = outcome.episodes[0];
  EXPECT_GT(e.added_s, 0);
  EXPECT_GT(e.taken_back_s, e.added_s);
  EXPECT_LT(e.taken_back_s, e.added_s + 2);
  EXPECT_NE(e.taken_back.find("coulomb_friction: "), std::string::npos) << e.taken_back;
  EXPECT_EQ(outcome.model_effects, 0u);
  EXPECT_TRUE(std::any_of(outcome.notices.begin(), outcome.notices.end(),
                          [](const auto& n) { return n.reason == Reason::kEffectTakenBack; }));
}

// Of a drive with and without a dead time, with one profile.
RawLog rows_of(const std::string& effects, double from_s, double to_s) {
  const std::string none = effects.empty() ? "effect = []\n" : "";
  Config config =
      Config::parse("preset = \"niewiara2020\"\n" + none + kDrive + effects, "live", {});
  read_all_tables(config);
  ClosedLoop loop(config);
  std::deque<MeasuredRow> rows;
  const DriveConfig& drive = config.drive();
  DeclaredLoad load(drive);
  while (static_cast<double>(loop.k()) * drive.T_s() < to_s) {
    const Measurement m = loop.step().measurement;
    const double t_s = static_cast<double>(m.k) * drive.T_s(), T_load = load.at(t_s);
    if (t_s >= from_s) rows.push_back({m, T_load});
  }
  return raw_log_of(rows, 0, rows.size());
}

TEST(LiveMonitor, NamesNothingThatTheRowsAfterTheFitWindowDoNotShow) {
  const auto traced = [](const RawLog& fitted, const RawLog& after) {
    const Config config =
        Config::parse(std::string("preset = \"niewiara2020\"\neffect = []\n") + kDrive, "live", {});
    TraceJob job{.drive = config.drive()};
    job.record = make_record(fitted, job.drive.machine.n_p, job.health);
    job.judging.assign(job.record.size(), 0);
    job.record.append(make_record(after, job.drive.machine.n_p, job.health));
    job.judging.resize(job.record.size(), 1);
    return run(job);
  };
  const std::string dead_time = "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 2e-6\n";
  const RawLog with = rows_of(dead_time, 0.5, 2), with_after = rows_of(dead_time, 2, 2.75);
  const TraceResult stays = traced(with, with_after);
  ASSERT_EQ(stays.effects.size(), 1u) << stays.sentence;
  EXPECT_EQ(stays.effects[0].effect->kind(), "dead_time");
  const TraceResult ends = traced(with, rows_of("", 2, 2.75));
  EXPECT_TRUE(ends.effects.empty()) << ends.sentence;
}

}  // namespace
}  // namespace twinrate

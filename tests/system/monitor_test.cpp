// twinrate-monitor with a process set whose plant changes during the run.
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/bus.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using Json = nlohmann::json;

const char* const kDrive = R"(
preset = "niewiara2020"
[rates]
f_s_Hz = 5000.0
[controller]
kind = "foc"
angle_source = "measured"
[controller.foc]
compensate_effects = true
speed_bandwidth_Hz = 15.0
[reference]
speed_rpm = [[0, 150], [0.5, 250], [1, 200], [1.5, 300], [2, 150], [2.5, 250], [3, 200], [3.5, 300], [4, 150], [4.5, 250]]
slew_rad_s2 = 300.0
[load]
T_load_Nm = [[0, 1], [0.25, 1], [0.75, 2.5], [1.25, 1.5], [1.75, 3], [2.25, 1], [2.75, 2.5], [3.25, 1.5], [3.75, 3], [4.25, 1], [4.75, 2.5]]
slew_Nm_s = 15.0
[run]
duration_s = 4.6
settle_s = 0.3
[monitor]
learn_s = 1.0
gather_s = 1.5
[[effect]]
kind = "resistance"
change_Ohm = 0.42
from_s = 1.6
)";

class Monitor : public ProgramTest {
 protected:
  std::string drive() const {
    std::ofstream(path("drive.toml")) << kDrive;
    return path("drive.toml");
  }
  // With the authority of the set that runs in path("run").
  std::vector<std::string> asking(std::vector<std::string> request) const {
    wait_until([&] { return std::filesystem::exists(path("run") + "/token"); });
    request.insert(request.end(), {"--run-dir", path("run")});
    return request;
  }
  static std::vector<EventRecord> events(const RunLog& log, Reason reason) {
    std::vector<EventRecord> some;
    for (const EventRecord& e : log.events)
      if (e.reason == static_cast<int>(reason)) some.push_back(e);
    return some;
  }
};

TEST_F(Monitor, ReportsProposesAndAddsAnEffectThatStartsDuringTheRun) {
  // The rows are gathered at 3.9 s. The run goes on for as long as a busy machine may trace them.
  const ProgramResult result =
      twinrate({"launch", drive(), "--monitor", "--duration", "7s", "--set",
                "monitor.auto_add=true", "--run-dir", path("run")},
               100);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const RunLog log = read_run_log(path("run"));
  const auto misfit = events(log, Reason::kModelMisfit);
  ASSERT_FALSE(misfit.empty());
  EXPECT_GT(misfit[0].k, 8000);
  EXPECT_LT(misfit[0].k, 12000);
  const auto proposed = events(log, Reason::kEffectProposed);
  ASSERT_FALSE(proposed.empty());
  EXPECT_NE(proposed[0].text.find("kind = \"resistance\""), std::string::npos) << proposed[0].text;
  // Estimator, gain and controller, all at one tick.
  const auto added = events(log, Reason::kEffectAdded);
  ASSERT_GE(added.size(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(added[static_cast<std::size_t>(i)].k, added[0].k);
  std::ifstream file(path("run") + "/monitor.json");
  const Json episodes = Json::parse(file)["episodes"];
  ASSERT_FALSE(episodes.empty());
  EXPECT_EQ(episodes[0]["kinds"][0], "resistance");
  // Events that differ stand each for itself.
  for (const char* event : {"estimator: twinrate-estimator: from", "gain: twinrate-gain: from",
                            "controller: twinrate-controller: from"})
    EXPECT_NE(result.out.find(event), std::string::npos) << result.out;
}

TEST_F(Monitor, FollowingRestartsWithANewSession) {
  for (const char* duration : {"0.6s", "0.3s"})
    ASSERT_EQ(
        twinrate({"simulate", "dilys2021", "--duration", duration, "--run-dir", path(duration)})
            .exit_code,
        0);
  Bus bus({.follow = true});
  status_t heartbeat{};
  bus.subscribe<status_t>([&](const status_t& s) {
    if (s.role == static_cast<int>(Role::kMonitor)) heartbeat = s;
  });
  const auto beats = [&](std::int64_t steps) {
    return wait_until([&] {
      bus.handle(10);
      return heartbeat.state >= static_cast<int>(ProcessState::kReady) && heartbeat.steps == steps;
    });
  };
  Program monitor(
      {"twinrate-monitor", "--config", "dilys2021", "--follow", "--run-dir", path(".")});
  ASSERT_TRUE(beats(0));
  std::int64_t played = 0;
  for (const auto& [run, ticks] : {std::pair{"0.6s", 3000}, {"0.3s", 1500}}) {
    EXPECT_EQ(twinrate({"replay", path(run), "--speed", "1", "--only", "MEASUREMENT"}).exit_code,
              0);
    EXPECT_TRUE(beats(played += ticks)) << heartbeat.steps;
    EXPECT_EQ(heartbeat.seq, ticks - 1);
  }
  monitor.signal(SIGTERM);
  EXPECT_EQ(monitor.wait(5).exit_code, 0);
}

TEST_F(Monitor, ReportsThatItCannotWriteItsFile) {
  const std::string file = path("monitor.json");
  Program monitor({"twinrate-monitor", "--config", "dilys2021", "--run-dir", path(".")});
  ASSERT_TRUE(wait_until([&] { return read_text(file).ends_with("}\n"); }));
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);
  monitor.signal(SIGTERM);
  const ProgramResult result = monitor.wait(5);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("monitor.json: cannot be written"), std::string::npos) << result.err;
  EXPECT_EQ(count_lines(result.err), 1) << result.err;
}

TEST_F(Monitor, ARequestThatIsNoEffectIsRefusedByAll) {
  std::ofstream(path("wrong.toml")) << "[[effect]]\nkind = \"resistance\"\nused_in = \"model\"\n"
                                       "change_Ohm = -5.0\n";
  Program launch({"twinrate", "launch", drive(), "--pace", "realtime", "--run-dir", path("run")});
  const ProgramResult result = twinrate(asking({"monitor", "add", path("wrong.toml")}));
  launch.signal(SIGINT);
  launch.wait(20);
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_EQ(count_lines(result.err), 1) << result.err;
  for (const char* part : {"wrong.toml:1: effect[0]", "leaves no resistance", "(refused by ",
                           "estimator", "gain", "controller"})
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
}

TEST_F(Monitor, ARequestWithoutTheTokenIsRefusedAndLogged) {
  write_text(path("own.toml"),
             "[[effect]]\nkind = \"resistance\"\nused_in = \"model\"\nchange_Ohm = 0.1\n");
  Program launch({"twinrate", "launch", drive(), "--pace", "realtime", "--run-dir", path("run")});
  ASSERT_TRUE(wait_until([&] { return std::filesystem::exists(path("run") + "/token"); }));
  struct stat token {};
  EXPECT_EQ(stat((path("run") + "/token").c_str(), &token), 0);
  EXPECT_EQ(token.st_mode & 0777, 0600u);
  const ProgramResult without = twinrate({"monitor", "add", path("own.toml")}),
                      elsewhere =
                          twinrate({"monitor", "add", path("own.toml"), "--run-dir", path("")});
  launch.signal(SIGINT);
  const ProgramResult run = launch.wait(20);
  EXPECT_EQ(without.exit_code, 1);
  EXPECT_NE(without.err.find("give its --run-dir"), std::string::npos) << without.err;
  EXPECT_EQ(elsewhere.exit_code, 2) << "no token there";
  EXPECT_NE(run.out.find("refused requests without a valid tag"), std::string::npos) << run.out;
  EXPECT_NE(run.out.find("messages refused"), std::string::npos) << run.out;
  const RunLog log = read_run_log(path("run"));
  EXPECT_FALSE(events(log, Reason::kRequestRefused).empty());
  EXPECT_TRUE(events(log, Reason::kEffectAdded).empty());
  EXPECT_FALSE(std::filesystem::exists(path("run") + "/token")) << "the run is over";
}

TEST_F(Monitor, AnInvalidFileIsNotSent) {
  const auto refusal = [&](const std::string& text) {
    write_text(path("bad.toml"), text);
    const ProgramResult result = twinrate({"monitor", "add", path("bad.toml")});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_LT(result.wall_s, 2) << "no drive is waited for";
    return result.err;
  };
  const std::string resistance = "\n[[effect]]\nkind = \"resistance\"\nused_in = \"model\"\n";
  for (const auto& [text, says] :
       {std::pair{resistance + "change_Ohm = \"much\"\n", "bad.toml:5: effect[0].change_Ohm: "},
        {resistance + "change_Ohm = 1.0\n[[effect]]\nkind = \"magic\"\n",
         "bad.toml:7: effect[1].kind: "},
        {std::string("[bus]\npin = true\n"), "bad.toml:1: bus: only [[effect]] tables allowed"},
        {std::string("kind = \n"), "bad.toml:1: "},
        {std::string("[[effect]]\nkind = \"resistance\"\nchange_Ohm = 1.0\n"),
         "bad.toml: no effect with used_in"}})
    EXPECT_NE(refusal(text).find(says), std::string::npos) << refusal(text);
}

TEST_F(Monitor, AnEffectOfAFileIsAddedFromTheNextTickOnAndRemovedAgain) {
  std::ofstream(path("own.toml")) << "[[effect]]\nkind = \"resistance\"\nused_in = \"model\"\n"
                                     "change_Ohm = 0.1\n";
  Program launch({"twinrate", "launch", drive(), "--pace", "realtime", "--run-dir", path("run")});
  const ProgramResult added = twinrate(asking({"monitor", "add", path("own.toml")})),
                      removed = twinrate(asking({"monitor", "remove", path("own.toml")})),
                      again = twinrate(asking({"monitor", "remove", path("own.toml")})),
                      far = twinrate(
                          asking({"monitor", "add", path("own.toml"), "--tick", "2000000"}));
  launch.signal(SIGINT);
  launch.wait(20);
  for (const ProgramResult& result : {added, removed}) {
    EXPECT_EQ(result.exit_code, 0) << result.err;
    for (const char* role : {"estimator: from tick", "gain: from tick", "controller: from tick"})
      EXPECT_NE(result.out.find(role), std::string::npos) << result.out;
  }
  EXPECT_EQ(far.exit_code, 2);
  EXPECT_NE(far.err.find("allowed now, 60 s ahead (refused by plant)"), std::string::npos)
      << far.err;
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_NE(again.err.find("own.toml: no resistance with these values was added"),
            std::string::npos)
      << again.err;
  EXPECT_EQ(events(read_run_log(path("run")), Reason::kEffectRemoved).size(), 3u);
}

}  // namespace
}  // namespace twinrate::test

// The logs of `twinrate launch` (five processes over LCM) and of `twinrate simulate` (one process,
// no bus) hold the same messages, bit for bit, also with lost datagrams.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using Overrides = std::vector<std::string>;

constexpr int kTicks = 2000;

std::vector<std::string> command(const std::string& verb, const std::string& drive,
                                 const std::string& run_dir, const Overrides& overrides,
                                 int ticks) {
  std::vector<std::string> list = {verb,    drive,        "--run-dir",
                                   run_dir, "--duration", fmt::format("{}ms", 0.2 * ticks)};
  for (const std::string& text : overrides) list.insert(list.end(), {"--set", text});
  return list;
}

// One test compares several runs of one directory.
std::vector<std::string> replacing(std::vector<std::string> command) {
  command.push_back("--force");
  return command;
}

class WireTest : public ProgramTest {
 protected:
  // `bus`: overrides that change only the transport; simulate does not need them.
  void expect_launch_equals_simulate(const std::string& drive, const Overrides& drive_overrides,
                                     const Overrides& bus = {}, int ticks = kTicks) {
    Overrides all = drive_overrides;
    all.insert(all.end(), bus.begin(), bus.end());
    const ProgramResult launched =
        twinrate(replacing(command("launch", drive, path("launch"), all, ticks)), 60);
    const ProgramResult simulated =
        twinrate(replacing(command("simulate", drive, path("simulate"), drive_overrides, ticks)));
    ASSERT_FALSE(launched.timed_out) << launched.err;
    EXPECT_EQ(launched.err, simulated.err);  // the warnings of the check, and nothing else
    EXPECT_EQ(launched.exit_code, simulated.exit_code) << launched.out;
    EXPECT_TRUE(same_messages(path("launch"), path("simulate"), ticks));
  }
  nlohmann::json summary(const std::string& run) const {
    return nlohmann::json::parse(read_text(path(run) + "/summary.json"));
  }
};

struct Drive {
  const char* name;
  const char* preset;
  Overrides overrides;
  int ticks = kTicks;
};
void PrintTo(const Drive& drive, std::ostream* out) {
  *out << drive.name;
}

class EveryDrive : public WireTest, public ::testing::WithParamInterface<Drive> {};

TEST_P(EveryDrive, GivesTheSameBitsOverTheBus) {
  expect_launch_equals_simulate(GetParam().preset, GetParam().overrides, {}, GetParam().ticks);
}

INSTANTIATE_TEST_SUITE_P(
    Wire, EveryDrive,
    ::testing::Values(
        Drive{"n1", "dilys2021", {"rates.n=1"}}, Drive{"n5", "dilys2021", {}},
        Drive{"n12", "dilys2021", {"rates.n=12"}},
        Drive{"n7_ends_between_snapshots", "dilys2021", {"rates.n=7"}},
        Drive{"immediate", "dilys2021", {"gain.policy=immediate"}},
        Drive{"immediate_n1", "dilys2021", {"gain.policy=immediate", "rates.n=1"}},
        Drive{"rotate", "dilys2021", {"gain.policy=rotate", "rates.n=20"}},
        Drive{"rotor_frame_from_100ms",
              "dilys2021",
              {"gain.policy=rotor_frame", "rates.n=7", "rates.n_from_s=0.1"}},
        Drive{"extrapolate", "dilys2021", {"gain.policy=extrapolate", "rates.n=12"}},
        Drive{"scheduled", "dilys2021", {"gain.policy=scheduled"}},
        Drive{"propagated", "dilys2021", {"gain.policy=propagated", "rates.n=50"}},
        Drive{"align_if", "dilys2021", {"start=align_if", "plant.theta_e_start_rad=2"}, 5000},
        Drive{"erk", "dilys2021", {"plant.engine=erk"}},
        Drive{"cvode", "dilys2021", {"plant.engine=cvode"}},
        Drive{"rk4_with_load", "dilys2021", {"estimator.prediction=rk4", "load.T_load_Nm=0.02"}},
        Drive{"truth_angle", "dilys2021", {"controller.angle_source=truth"}},
        Drive{"no_computation_delay", "dilys2021", {"plant.delay_samples=0"}},
        Drive{"salient_dq_ekf", "kim-ipmsm", {"rates.f_s_Hz=5000", "start=flying"}, 1500},
        Drive{"salient_eemf",
              "kim-ipmsm",
              {"rates.f_s_Hz=5000", "start=flying", "estimator.kind=eemf"},
              1500},
        Drive{"salient_printed",
              "kim-ipmsm",
              {"rates.f_s_Hz=5000", "start=flying", "estimator.kind=backemf_printed"},
              1500},
        Drive{"salient_start_locks_first", "kim-ipmsm", {"rates.f_s_Hz=5000", "rates.n=10"}, 1500},
        Drive{"immediate_locks_first",
              "dilys2021",
              {"rates.n_from=locked", "gain.policy=immediate"},
              1000},
        Drive{"propagated_locks_first",
              "dilys2021",
              {"rates.n_from=locked", "gain.policy=propagated", "rates.n=20"},
              1000},
        Drive{"rotor_frame_locks_first",
              "dilys2021",
              {"rates.n_from=locked", "gain.policy=rotor_frame", "rates.n=7"},
              1000},
        Drive{"joint_with_a_harmonic",
              "niewiara2020",
              {"rates.f_s_Hz=5000", "rates.n=10", "start=flying", "estimator.kind=ekf_joint",
               "estimator.ekf_joint.order=6", "reference.speed_rpm=100"},
              1500},
        Drive{"lost_at_n13", "dilys2021", {"rates.n=13"}},
        Drive{"switched_with_every_reference_effect",
              "niewiara2020",
              {"rates.f_s_Hz=5000", "plant.inverter=switched"},
              800}),
    [](const auto& drive) { return drive.param.name; });

TEST_F(WireTest, DisturbanceFilterOnTheMeasuredAngleGivesTheSameBits) {
  write_text(path("drive.toml"), R"(preset = "dilys2021"
[sensors]
encoder_counts = 4096
[estimator]
kind = "ekf_disturbance"
[controller]
angle_source = "measured"
)");
  expect_launch_equals_simulate(path("drive.toml"), {});
}

TEST_F(WireTest, DroppedDatagramsChangeNoBitOfAStartThatLocksFirst) {
  expect_launch_equals_simulate("dilys2021", {"rates.n_from=locked"}, {"bus.drop_rate=0.01"}, 1000);
  EXPECT_EQ(summary("launch")["n_from_tick"], summary("simulate")["n_from_tick"]);
  EXPECT_GT(summary("launch")["n_from_tick"], 50);
  for (const auto& [channel, lost] : summary("launch")["lost_messages"].items())
    EXPECT_EQ(lost, 0) << channel;
}

TEST_F(WireTest, TwoLaunchesGiveTheSameBits) {
  for (const char* run : {"a", "b"})
    ASSERT_EQ(twinrate(command("launch", "dilys2021", path(run), {}, kTicks)).exit_code, 0);
  EXPECT_TRUE(same_messages(path("a"), path("b"), kTicks));
}

TEST_F(WireTest, DroppedDatagramsAreRepeatedAndChangeNoBit) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.drop_rate=0.01"});
  EXPECT_GT(summary("launch")["repeats"], 10);
  for (const auto& [channel, lost] : summary("launch")["lost_messages"].items())
    EXPECT_EQ(lost, 0) << channel;
}

TEST_F(WireTest, DroppedTruthIsRepeatedForAControllerThatUsesIt) {
  expect_launch_equals_simulate("dilys2021", {"controller.angle_source=truth"},
                                {"bus.drop_rate=0.05"}, 300);
}

// Short runs: no later message makes a lost last message visible.

TEST_F(WireTest, NeitherTheFirstNorTheLastMessagesAreMissedWhenMuchIsDropped) {
  for (int ticks = 36; ticks <= 42; ++ticks) {
    SCOPED_TRACE(ticks);
    const int seed = ticks;
    expect_launch_equals_simulate("dilys2021", {fmt::format("run.seed={}", seed)},
                                  {"bus.drop_rate=0.2"}, ticks);
  }
}

TEST_F(WireTest, OnePortALinkGivesTheSameBits) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.split_ports=true"});
}
TEST_F(WireTest, ThroughSharedMemoryTheBitsAreTheSame) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.shared_memory=true"});
}
TEST_F(WireTest, ThroughSharedMemoryDropsChangeNoBitOfAStartThatLocksFirst) {
  expect_launch_equals_simulate(
      "dilys2021", {"rates.n_from=locked"},
      {"bus.shared_memory=true", "bus.window_ticks=16", "bus.drop_rate=0.01"}, 500);
  EXPECT_GT(summary("launch")["repeats"], 5);
}
TEST_F(WireTest, WithoutTheKernelFilterTheBitsAreTheSame) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.filter=false"});
}
TEST_F(WireTest, UnpinnedTheBitsAreTheSame) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.pin=false"});
}
TEST_F(WireTest, WithATinyWindowTheBitsAreTheSame) {
  expect_launch_equals_simulate("dilys2021", {}, {"bus.window_ticks=16"});
}

TEST_F(WireTest, ATinyWindowSplitPortsAndDropsTogetherChangeNothing) {
  expect_launch_equals_simulate(
      "dilys2021", {}, {"bus.window_ticks=16", "bus.split_ports=true", "bus.drop_rate=0.02"}, 500);
}

TEST_F(WireTest, OnABusyMachineTheBitsAreTheSame) {
  std::vector<std::unique_ptr<Program>> load;
  load.reserve(3);
  for (int i = 0; i < 3; ++i)
    load.push_back(
        std::make_unique<Program>(std::vector<std::string>{"sh", "-c", "while :; do :; done"}));
  expect_launch_equals_simulate("dilys2021", {});
}

}  // namespace
}  // namespace twinrate::test

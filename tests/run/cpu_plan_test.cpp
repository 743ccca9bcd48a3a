#include "run/cpu_plan.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>

namespace twinrate {
namespace {

namespace fs = std::filesystem;

TEST(CpuPlan, ARingTakesTheCpuWithTheFewestRings) {
  const OtherSet at_0{.ring_cpu = 0}, at_1{.ring_cpu = 1}, not_pinned{};
  const auto ring = [](const std::vector<OtherSet>& sets,
                       const std::vector<int>& allowed = {0, 1}) {
    const CpuPlan plan = plan_cpus(allowed, sets);
    EXPECT_NE(plan.ring, plan.others);
    return plan.ring;
  };
  EXPECT_EQ(ring({}), 0);
  EXPECT_EQ(ring({not_pinned}), 0);
  EXPECT_EQ(ring({at_0}), 1);
  EXPECT_EQ(ring({at_1}), 0);
  EXPECT_EQ(ring({at_0, at_1}), 0);
  EXPECT_EQ(ring({at_0, at_1, at_0}), 1);
  EXPECT_EQ(ring({at_0, at_1}, {0, 1, 5}), 5);
  EXPECT_EQ(plan_cpus({0, 1, 5}, {at_0}).others, 5);
  EXPECT_EQ(plan_cpus({3}, {}).ring, -1);
}

class ProcessTable : public ::testing::Test {
 public:
  ~ProcessTable() override { fs::remove_all(proc_); }

 protected:
  void add(int pid, const std::vector<std::string>& words, const char* network) {
    const fs::path process = proc_ / std::to_string(pid);
    fs::create_directories(process / "ns");
    std::ofstream file(process / "cmdline", std::ios::binary);
    for (const std::string& word : words) file << word << '\0';
    fs::create_symlink(network, process / "ns/net");
  }
  fs::path proc_ = fs::temp_directory_path() / ("cpu-plan-" + std::to_string(getpid()));
};

TEST_F(ProcessTable, HoldsThePlantsOfOtherSets) {
  fs::create_directories(proc_ / "self/ns");
  fs::create_symlink("net:[1]", proc_ / "self/ns/net");
  add(17,
      {"/opt/bin/twinrate-plant", "--pace", "realtime", "--run-dir", "runs/a", "--lcm-url",
       "udpm://a", "--cpu", "1"},
      "net:[1]");
  add(9, {"twinrate-bridge", "--pace", "lockstep", "--run-dir", "runs/b"}, "net:[2]");
  add(11, {"twinrate-gain", "--pace", "realtime", "--cpu", "0"}, "net:[1]");
  add(12, {"vi", "twinrate-plant"}, "net:[1]");
  add(13, {}, "net:[1]");
  const std::vector<OtherSet> sets = other_sets(proc_.string());
  ASSERT_EQ(sets.size(), 2u);
  EXPECT_EQ(sets[0].run_dir, "runs/b");
  EXPECT_FALSE(sets[0].realtime);
  EXPECT_FALSE(sets[0].same_network);
  EXPECT_EQ(sets[0].ring_cpu, -1);
  EXPECT_EQ(sets[1].run_dir, "runs/a");
  EXPECT_TRUE(sets[1].realtime);
  EXPECT_TRUE(sets[1].same_network);
  EXPECT_EQ(sets[1].ring_cpu, 1);

  const auto said = [&](const CpuPlan& plan, const char* url, bool filtered = false) {
    const std::vector<std::string> lines = realtime_beside(sets, plan, url, filtered);
    EXPECT_EQ(lines.size(), 1u);
    return lines.empty() ? "" : lines[0];
  };
  EXPECT_NE(said({0, 1}, "udpm://b").find("CPU 1, that of this set on CPU 0"), std::string::npos);
  EXPECT_NE(said({1, 0}, "udpm://b").find("both rings are on CPU 1"), std::string::npos);
  EXPECT_EQ(said({0, 1}, "udpm://b").find("--lcm-url"), std::string::npos);
  EXPECT_NE(said({0, 1}, "udpm://a").find("--lcm-url"), std::string::npos);
  EXPECT_EQ(said({0, 1}, "udpm://a", true).find("--lcm-url"), std::string::npos);
}

// Two launches at once would both find no other set.
TEST(PlanLock, IsHeldByOneAtATimeAndHaltsNobody) {
  using Clock = std::chrono::steady_clock;
  {
    const PlanLock first;
    ASSERT_TRUE(first.held());
    const auto begun = Clock::now();
    EXPECT_FALSE(PlanLock().held());
    EXPECT_GE(Clock::now() - begun, std::chrono::duration<double>(PlanLock::kPatience_s));
  }
  EXPECT_TRUE(PlanLock().held());
}

}  // namespace
}  // namespace twinrate

// A log that is read one tick after the other has the figures of the log in memory.
#include "analysis/long_log.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <lcm/lcm-cpp.hpp>

#include "loop/load_drive.hpp"
#include "run/simulated_run.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

class LongLogTest : public ::testing::Test {
 protected:
  LongLogTest() {
    char pattern[] = "/tmp/long-log-XXXXXX";
    directory_ = mkdtemp(pattern);
  }
  ~LongLogTest() override { fs::remove_all(directory_); }
  // A run of 4000 ticks with an encoder.
  Config run(std::vector<std::string> overrides = {}) {
    overrides.insert(overrides.end(), {"run.duration_s=0.8", "run.settle_s=0.2"});
    Config config = load_drive("dilys2021", overrides);
    EXPECT_EQ(run_simulated(config, directory_, false), "");
    return config;
  }
  std::string log() const { return directory_ + "/log.lcm"; }
  // The log without TRUTH, as a real drive leaves it.
  std::string without_truth() const {
    const std::string path = directory_ + "/other.lcm";
    lcm::LogFile in(log(), "r"), out(path, "w");
    while (const lcm::LogEvent* event = in.readNextEvent())
      if (event->channel != "DRIVE_TRUTH") {
        lcm::LogEvent copy = *event;
        out.writeEvent(&copy);
      }
    return path;
  }
  static void expect_same(const std::string& path, const DriveConfig& drive) {
    const Summary whole = summarise(read_run_log(path), drive);
    const LongLog found = summarise_log(path, drive, OnDamage::kRefuse, 500);
    EXPECT_EQ(to_json(found.summary, drive), to_json(whole, drive));
    EXPECT_EQ(found.log.measurement.size(), 500u);
    EXPECT_EQ(found.log.counts[0], drive.steps());
    EXPECT_EQ(found.last_k - found.first_k, 499);
  }
  std::string directory_;
};

TEST_F(LongLogTest, FiguresWithTruthAreThoseOfTheLogInMemory) {
  Config config = run();
  expect_same(log(), config.drive());
  const LongLog found = summarise_log(log(), config.drive(), OnDamage::kRefuse, 500);
  EXPECT_EQ(found.last_k, 3999);
  EXPECT_EQ(window_of_part(found), 0) << "the part begins after settle_s";
  EXPECT_FALSE(found.log.gain.empty());
  EXPECT_EQ(found.log.estimate.back().gain_seq, read_run_log(log()).estimate.back().gain_seq);
}

TEST_F(LongLogTest, FiguresWithoutTruthAreThoseOfTheLogInMemory) {
  Config config = run({"sensors.encoder_counts=4096"});
  expect_same(without_truth(), config.drive());
}

TEST_F(LongLogTest, OfALostRunThePartIsTheOneAroundTheLoss) {
  Config config = run({"plant.fault.kind=command_missing", "plant.fault.at_s=0.3"});
  expect_same(log(), config.drive());
  const LongLog found = summarise_log(log(), config.drive(), OnDamage::kRefuse, 500);
  ASSERT_TRUE(found.summary.lost_at_s);
  const double lost_k = *found.summary.lost_at_s * config.drive().rates.f_s_Hz;
  EXPECT_NEAR(static_cast<double>(found.last_k), lost_k + 125, 2);
}

}  // namespace
}  // namespace twinrate

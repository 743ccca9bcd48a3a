// The tools on a log of wire schema 4, which twinrate simulate dilys2021 wrote before messages had
// tags: 220 ticks.
#include "core/run_log.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class EarlierLog : public ProgramTest {
 protected:
  static constexpr int kLoggedTicks = 220;
  std::string log() const { return std::string(TWINRATE_CONFIG) + "/../tests/core/schema_4.lcm"; }
  void expect_done(const std::vector<std::string>& arguments, const std::string& says) {
    const ProgramResult result = twinrate(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err << result.out;
    EXPECT_NE(result.out.find(says), std::string::npos) << result.out;
  }
};

TEST_F(EarlierLog, IsReadWhole) {
  const RunLog read = read_run_log(log());
  EXPECT_EQ(read.measurement.size(), kLoggedTicks);
  EXPECT_EQ(read.truth.size(), kLoggedTicks);
  EXPECT_EQ(read.estimate.size(), kLoggedTicks);
  EXPECT_EQ(read.command.size(), kLoggedTicks);
  EXPECT_EQ(read.reference.size(), kLoggedTicks);
  EXPECT_GT(read.gain.size(), 40u);
  EXPECT_FALSE(read.config_toml.empty());
  EXPECT_EQ(read.damage, "");
  EXPECT_EQ(read.estimate.back().k, kLoggedTicks - 1);
  EXPECT_EQ(read.estimate.back().n_x, 4);
  EXPECT_GT(read.measurement.back().v_dc, 1);
}

TEST_F(EarlierLog, IsExportedReportedAndTraced) {
  expect_done({"export", log(), "--format", "csv", "--out", path("csv")}, "219 samples");
  expect_done({"export", log(), "--format", "mcap", "--out", path("log.mcap")}, "log.mcap");
  expect_done({"report", log(), "--out", path("report.html"), "--json"}, "{\"page\":");
  expect_done({"trace", "dilys2021", "--data", log(), "--out", path("trace")}, "trace.json");
}

// The bits of its estimates are those of the machine that wrote it.
TEST_F(EarlierLog, FeedsTheProcesses) {
  const ProgramResult result = twinrate({"replay", log(), "--lockstep"});
  EXPECT_LE(result.exit_code, 1) << result.err;
  EXPECT_NE(result.out.find("replayed 220 ticks"), std::string::npos) << result.out << result.err;
  EXPECT_NE(result.out.find("0 not in the log"), std::string::npos) << result.out;
  const ProgramResult as_json = twinrate({"replay", log(), "--lockstep", "--json"});
  EXPECT_TRUE(as_json.out.starts_with("{\"ticks\":220,")) << as_json.out;
  EXPECT_EQ(as_json.out.find('\n'), as_json.out.size() - 1) << as_json.out;
}

}  // namespace
}  // namespace twinrate::test

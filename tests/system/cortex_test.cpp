// The emulated Cortex-M3 in the place of estimator and gain of a launched set, with twinrate-plant,
// twinrate-controller and twinrate-logger as processes.
#include <algorithm>

#include "core/run_log.hpp"
#include "embedded/fixed_estimator.hpp"
#include "embedded/instruction_counts.hpp"
#include "loop/load_drive.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class CortexRun : public ProgramTest {
 protected:
  // 150 instructions between two control interrupts: each background run is interrupted.
  ProgramResult launch(const std::string& link, const std::string& name) {
    return twinrate({"launch", "dilys2021", "--duration", "40ms", "--set", "run.settle_s=0.02",
                     "--set", "rates.n=5", "--run-dir", path(name), "--own",
                     "estimator,gain=cortex_m3 estimator --period-us 4.8 --link " + link});
  }
};

TEST_F(CortexRun, BothLinksGiveEqualLogsAndTheEstimatesOfTheHostBuild) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const ProgramResult first = launch("semihosting", "a");
  ASSERT_NE(first.out.find("lock-step"), std::string::npos) << first.out << first.err;
  launch("semihosting", "b");
  launch("uart", "uart");
  const auto a = tick_messages(path("a"));
  EXPECT_EQ(std::count_if(a.begin(), a.end(),
                          [](const auto& m) { return m.channel == "DRIVE_ESTIMATE"; }),
            200);
  EXPECT_EQ(
      std::count_if(a.begin(), a.end(), [](const auto& m) { return m.channel == "DRIVE_GAIN"; }),
      40);
  EXPECT_TRUE(same_messages(path("a"), path("b"), 200));
  EXPECT_TRUE(same_messages(path("a"), path("uart"), 200));

  Config config = load_drive("dilys2021", {"rates.n=5"});
  Fixed32 host(config);
  const RunLog log = read_run_log(path("a"));
  ASSERT_EQ(log.estimate.size(), log.measurement.size());
  for (std::size_t k = 0; k < log.estimate.size(); ++k) {
    const Estimate& e = host.tick(log.measurement[k]);
    ASSERT_EQ(e.x_hat, log.estimate[k].x_hat) << k;
    ASSERT_EQ(e.gain_seq, log.estimate[k].gain_seq) << k;
  }
}

TEST_F(CortexRun, AnOwnProgramThatIsNotThereIsOneLine) {
  for (const char* own : {"estimator=none_such", "estimator", "wheel=x", "=x"}) {
    const ProgramResult r =
        twinrate({"launch", "dilys2021", "--run-dir", path("none"), "--own", own});
    EXPECT_GE(r.exit_code, 2) << own;
    EXPECT_EQ(count_lines(r.err), 1) << r.err;
  }
}

}  // namespace
}  // namespace twinrate::test

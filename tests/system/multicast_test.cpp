// What the programs do on a machine that cannot carry multicast: exit code 3 with the mend, or they
// mend it themselves.
#include "core/multicast.hpp"

#include <sys/stat.h>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class Multicast : public ProgramTest {
 protected:
  // A namespace without loopback, where nothing may be changed: CAP_NET_ADMIN is out of reach.
  std::vector<std::string> without_rights(std::vector<std::string> arguments) {
    std::vector<std::string> list = {"setpriv", "--bounding-set=-net_admin",
                                     "--inh-caps=-net_admin"};
    list.insert(list.end(), arguments.begin(), arguments.end());
    return list;
  }
  void SetUp() override {
    ProgramTest::SetUp();
    if (!IsSkipped()) enter_network_namespace(false);
  }
};

TEST_F(Multicast, LaunchBringsItUpWhereItMay) {
  ASSERT_FALSE(multicast_route_exists(kDefaultMulticastAddress));
  const ProgramResult result =
      twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", "0.1s"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("ip route add 224.0.0.0/4 dev lo"), std::string::npos)
      << "it says what it did";
  EXPECT_TRUE(multicast_route_exists(kDefaultMulticastAddress));
}

TEST_F(Multicast, WithoutTheRightsLaunchSaysTheTwoCommands) {
  if (run_program({"setpriv", "--bounding-set=-net_admin", "true"}).exit_code != 0)
    GTEST_SKIP() << "setpriv cannot drop CAP_NET_ADMIN here";
  const ProgramResult result =
      run_program(without_rights({TWINRATE_PROGRAM, "launch", "dilys2021", "--run-dir", path("run"),
                                  "--duration", "0.1s"}),
                  20);
  EXPECT_EQ(result.exit_code, 3) << result.err;
  EXPECT_EQ(count_lines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find(multicast_mend()), std::string::npos) << result.err;
}

TEST_F(Multicast, AProcessAloneSaysTheTwoCommands) {
  for (const char* program : {"twinrate-plant", "twinrate-estimator", "twinrate-logger"}) {
    const ProgramResult result =
        run_program({program, "--config", "dilys2021", "--run-dir", path("")}, 20);
    EXPECT_EQ(result.exit_code, 3) << result.err;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_NE(result.err.find(multicast_mend()), std::string::npos) << result.err;
  }
}

TEST_F(Multicast, SimulateNeedsNone) {
  EXPECT_EQ(
      twinrate({"simulate", "dilys2021", "--run-dir", path("run"), "--duration", "0.1s"}).exit_code,
      0);
}

}  // namespace
}  // namespace twinrate::test

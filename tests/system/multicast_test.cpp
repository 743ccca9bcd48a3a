// The programs on a machine without multicast: they add a route, or end with exit code 3 and the
// command.
#include "core/multicast.hpp"

#include <sys/stat.h>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class Multicast : public ProgramTest {
 protected:
  // A namespace without loopback and without CAP_NET_ADMIN.
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

TEST_F(Multicast, LaunchAddsARouteIfPermitted) {
  ASSERT_FALSE(multicast_route_exists(kDefaultMulticastAddress));
  const ProgramResult doctor = twinrate({"doctor", "--json"});
  EXPECT_EQ(doctor.exit_code, 3);
  EXPECT_TRUE(doctor.out.ends_with("{\"launch_can_run\":false,\"launch_tries_to_mend\":true}\n"))
      << doctor.out;
  const ProgramResult result =
      twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", "0.1s"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("ip route add 224.0.0.0/4 dev lo"), std::string::npos)
      << "it says what it did";
  EXPECT_TRUE(multicast_route_exists(kDefaultMulticastAddress));
}

TEST_F(Multicast, WithoutThePermissionLaunchPrintsTheTwoCommands) {
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

TEST_F(Multicast, AProcessAlonePrintsTheTwoCommands) {
  for (const char* program : {"twinrate-plant", "twinrate-estimator", "twinrate-logger"}) {
    const ProgramResult result =
        run_program({program, "--config", "dilys2021", "--run-dir", path("")}, 20);
    EXPECT_EQ(result.exit_code, 3) << result.err;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_NE(result.err.find(multicast_mend()), std::string::npos) << result.err;
  }
}

// As on a PC with a network: the route to the group leads to lo, the machine's address is elsewhere.
TEST_F(Multicast, LaunchIsHeardBesideAnInterfaceWithAnAddress) {
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"ip", "link", "add", "twin0", "type", "veth", "peer", "name", "twin1"},
           {"ip", "addr", "add", "192.0.2.2/24", "dev", "twin0"},
           {"ip", "link", "set", "twin0", "up"}})
    if (run_program(command).exit_code != 0)
      GTEST_SKIP() << "no pair of interfaces can be made here (iproute2, veth)";
  std::string done;
  ASSERT_TRUE(try_bring_up_multicast(done)) << done;
  const ProgramResult result =
      twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", "0.1s"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
}

TEST_F(Multicast, SimulateNeedsNoMulticast) {
  EXPECT_EQ(
      twinrate({"simulate", "dilys2021", "--run-dir", path("run"), "--duration", "0.1s"}).exit_code,
      0);
}

}  // namespace
}  // namespace twinrate::test

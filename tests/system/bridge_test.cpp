// A drive behind the bridge, as an emulated device: launched, listened to, probed.
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class BridgeRun : public ProgramTest {
 protected:
  // Messages of a run but TRUTH, which a real drive does not tell.
  static std::vector<LoggedMessage> without_truth(const std::string& run) {
    std::vector<LoggedMessage> list = tick_messages(run);
    std::erase_if(list, [](const LoggedMessage& m) { return m.channel == "DRIVE_TRUTH"; });
    return list;
  }
  std::string tty() const { return path("tty"); }
  // All but the time: of one tick, the same bits.
  static bool same_readings(const Measurement& a, const Measurement& b) {
    return a.k == b.k && a.signals == b.signals && a.i_abc == b.i_abc &&
           a.u_alphabeta == b.u_alphabeta && a.duty_abc == b.duty_abc && a.v_dc == b.v_dc &&
           a.theta_m == b.theta_m && a.omega_m == b.omega_m;
  }
  bool emulator_is_there() const {
    return wait_until([&] { return std::filesystem::exists(tty()); });
  }
};

TEST_F(BridgeRun, InLockStepEqualsTheSimulatedRunBitForBit) {
  const ProgramResult simulated =
      twinrate({"simulate", "dilys2021", "--duration", "200ms", "--run-dir", path("simulated")});
  const ProgramResult launched =
      twinrate({"launch", "dilys2021", "--duration", "200ms", "--run-dir", path("launched"),
                "--set", "plant.kind=bridge", "--set", "bridge.emulate=true"});
  ASSERT_EQ(launched.exit_code, simulated.exit_code) << launched.err << launched.out;
  const auto a = without_truth(path("simulated")), b = without_truth(path("launched"));
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    ASSERT_EQ(a[i], b[i]) << a[i].channel << "(" << a[i].seq << ")";
  EXPECT_EQ(std::count_if(b.begin(), b.end(),
                          [](const auto& m) { return m.channel == "DRIVE_MEASUREMENT"; }),
            1000);
  const auto link = nlohmann::json::parse(read_text(path("launched") + "/link.json"));
  EXPECT_GE(link["frames"], 1000);
  EXPECT_EQ(link["lost"], 0);
}

TEST_F(BridgeRun, APulledCableEndsTheRunWithItsReason) {
  const Program emulator({"twinrate-emulator", "dilys2021", "--pty", tty(), "--baud", "0",
                          "--fault", "pulled_at_s=0.3"});
  ASSERT_TRUE(emulator_is_there());
  const ProgramResult result = twinrate({"bridge", "run", "dilys2021", "--port", tty(),
                                         "--duration", "1000s", "--run-dir", path("run")});
  EXPECT_EQ(result.exit_code, 1) << result.out;
  EXPECT_NE(result.out.find("TRIPPED"), std::string::npos) << result.out << result.err;
  EXPECT_NE(result.out.find("link_lost"), std::string::npos) << result.out;
  EXPECT_LT(result.wall_s, 10);
}

TEST_F(BridgeRun, AListenedFileIsLoggedAsItsImport) {
  ASSERT_EQ(
      twinrate({"simulate", "dilys2021", "--duration", "200ms", "--run-dir", path("sim")}).err, "");
  ASSERT_EQ(twinrate({"export", path("sim"), "--format", "csv", "--out", path("x.csv")}).exit_code,
            0);
  ASSERT_EQ(
      twinrate({"import", path("x.csv"), "--drive", "dilys2021", "--out", path("x.lcm")}).exit_code,
      0);
  const Program emulator({"twinrate-emulator", "dilys2021", "--pty", tty(), "--baud", "0", "--log",
                          path("x.csv"), "--speed", "0.2"});
  ASSERT_TRUE(emulator_is_there());
  const ProgramResult result = twinrate({"bridge", "listen", "dilys2021", "--port", tty(),
                                         "--duration", "199.8ms", "--run-dir", path("run")});
  const RunLog imported = read_run_log(path("x.lcm")), listened = read_run_log(path("run"));
  ASSERT_EQ(imported.measurement.size(), 999u);
  ASSERT_EQ(listened.measurement.size(), 999u) << result.out << result.err;
  EXPECT_GT(listened.estimate.size(), 900u);
  for (std::size_t i = 0; i < 999; ++i) {
    EXPECT_EQ(imported.measurement[i].t_ns, listened.measurement[i].t_ns);
    ASSERT_TRUE(same_readings(imported.measurement[i], listened.measurement[i])) << i;
  }
}

// A motor of a public bench, whose recorder had no fixed rate; the time of a sample is that of its tick.
TEST_F(BridgeRun, ARealMotorsFileAtItsOwnPaceIsLoggedAsItsImport) {
  const char* given = std::getenv("TWINRATE_MEASURED");
  const std::string file = (given ? std::string(given) : TWINRATE_CONFIG "/../../shared/measured") +
                           "/laas_cogging/speed_test_old.csv";
  const std::string map = TWINRATE_CONFIG "/../tools/maps/laas_speed_test.toml";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file << " (TWINRATE_MEASURED)";
  ASSERT_EQ(twinrate({"import", file, "--map", map, "--out", path("x.lcm")}).exit_code, 0);
  const Program emulator({"twinrate-emulator", "laas_mn4004", "--pty", tty(), "--baud", "0",
                          "--log", file, "--map", map});
  ASSERT_TRUE(emulator_is_there());
  const ProgramResult result = twinrate({"bridge", "listen", "laas_mn4004", "--port", tty(),
                                         "--duration", "2s", "--run-dir", path("run")});
  const RunLog imported = read_run_log(path("x.lcm")), listened = read_run_log(path("run"));
  ASSERT_GT(listened.measurement.size(), 1900u) << result.out << result.err;
  ASSERT_GT(imported.measurement.size(), listened.measurement.size());
  for (std::size_t i = 0; i < listened.measurement.size(); ++i)
    ASSERT_TRUE(same_readings(imported.measurement[i], listened.measurement[i])) << i;
  EXPECT_EQ(listened.estimate.size(), listened.measurement.size());
  // Without voltages the filter has two states instead of four: its gains are used all the same.
  ASSERT_GT(listened.gain.size(), 1900u);
  EXPECT_GT(listened.gain.back().P_diagonal(1), 0);
  EXPECT_EQ(listened.gain.back().P_diagonal(2), 0);
  std::size_t used = 0;
  for (const Estimate& e : listened.estimate) used += e.gain_seq > 0;
  EXPECT_GT(used, 1500u);
}

TEST_F(BridgeRun, ProbeShowsTheDriveAndClearsByHandAlone) {
  const Program emulator(
      {"twinrate-emulator", "--config", "dilys2021", "--pty", tty(), "--set", "rates.f_s_Hz=1000"});
  ASSERT_TRUE(emulator_is_there());
  const ProgramResult probe = twinrate({"bridge", "probe", "dilys2021", "--port", tty(), "--for",
                                        "0.3", "--set", "rates.f_s_Hz=1000"});
  EXPECT_EQ(probe.exit_code, 0) << probe.err;
  EXPECT_NE(probe.out.find("1000 Hz"), std::string::npos) << probe.out;
  EXPECT_NE(probe.out.find("lease up to 20 ms"), std::string::npos) << probe.out;
  EXPECT_NE(probe.out.find("not latched"), std::string::npos) << probe.out;
  const ProgramResult json = twinrate({"bridge", "probe", "dilys2021", "--port", tty(), "--for",
                                       "0.2", "--json", "--set", "rates.f_s_Hz=1000"});
  EXPECT_EQ(json.exit_code, 0) << json.err;
  std::istringstream lines(json.out);
  std::vector<std::string> events;
  for (std::string line; std::getline(lines, line);)
    events.push_back(nlohmann::json::parse(line).at("event"));
  EXPECT_EQ(events, (std::vector<std::string>{"drive", "round_trip", "samples"})) << json.out;
  EXPECT_NE(json.out.find("\"lease_max_ms\":20"), std::string::npos) << json.out;
  const ProgramResult other = twinrate({"bridge", "probe", "dilys2021", "--port", tty()});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("samples at 1000 Hz"), std::string::npos) << other.err;
}

// The line is too slow for the samples of a probe, which are still on it when the run begins.
TEST_F(BridgeRun, AfterAProbeARunInLockStepLocks) {
  const Program emulator({"twinrate-emulator", "dilys2021", "--pty", tty()});
  ASSERT_TRUE(emulator_is_there());
  const ProgramResult probe =
      twinrate({"bridge", "probe", "dilys2021", "--port", tty(), "--for", "0.2"});
  EXPECT_EQ(probe.exit_code, 0) << probe.err;
  EXPECT_NE(probe.out.find(" a second of 5000"), std::string::npos) << probe.out;
  const ProgramResult run = twinrate({"bridge", "run", "dilys2021", "--port", tty(), "--duration",
                                      "60ms", "--run-dir", path("run")});
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_EQ(read_run_log(path("run")).measurement.size(), 300u);
}

TEST_F(BridgeRun, BadInputIsOneLine) {
  const auto refused = [](const std::vector<std::string>& arguments, int code, const char* text) {
    const ProgramResult r = run_program(arguments);
    EXPECT_EQ(r.exit_code, code) << text << r.err;
    EXPECT_EQ(count_lines(r.err), 1) << r.err;
    EXPECT_NE(r.err.find(text), std::string::npos) << r.err;
  };
  refused({"twinrate", "bridge", "probe", "dilys2021"}, 2, "bridge.port");
  refused({"twinrate", "bridge", "probe", "dilys2021", "--port", "/dev/none"}, 3, "/dev/none");
  refused({"twinrate-emulator", "dilys2021"}, 2, "exactly one of --pty and --udp");
  refused({"twinrate-emulator", "dilys2021", "--pty", tty(), "--fault", "rain=1"}, 2, "bit_errors");
  refused({"twinrate-emulator", "dilys2021", "--pty", tty(), "--fault", "lost=2"}, 2, "0 to 1");
  refused({"twinrate-emulator", "dilys2021", "--udp", "nowhere"}, 2, "HOST:PORT");
}

}  // namespace
}  // namespace twinrate::test

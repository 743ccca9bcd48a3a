// Bad input: one line with place, key and allowed values, and exit code 2. No process is started,
// no file written.
#include <filesystem>
#include <lcm/lcm-cpp.hpp>

#include "core/channels.hpp"
#include "core/manifest.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class BadInput : public ProgramTest {
 protected:
  void expect_refused(const ProgramResult& result, const std::vector<std::string>& said) {
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_EQ(result.out, "");
    for (const std::string& text : said)
      EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("run")));
    EXPECT_TRUE(processes_with(path("run")).empty());
  }
  ProgramResult launch(const std::string& drive, std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"launch", drive, "--run-dir", path("run"), "--duration", "0.1s"});
    return twinrate(more, 20);
  }
  std::string drive(const std::string& text) {
    write_text(path("drive.toml"), text);
    return path("drive.toml");
  }
  template <class Message>
  static void append(lcm::LogFile& file, Channel channel, Message message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    append_bytes(file, channel, bytes);
  }
  static void append_bytes(lcm::LogFile& file, Channel channel, std::vector<std::uint8_t>& bytes) {
    lcm::LogEvent event;
    event.timestamp = 1;
    event.channel = info(channel).name;
    event.datalen = static_cast<int>(bytes.size());
    event.data = bytes.data();
    file.writeEvent(&event);
  }
};

TEST_F(BadInput, UnknownKey) {
  expect_refused(launch(drive("preset = \"dilys2021\"\n\n[machine]\nR_s = 1.0\n")),
                 {"drive.toml:4", "machine.R_s", "unknown key", "R_s_Ohm"});
}
TEST_F(BadInput, ARealDriveWithoutAPort) {
  expect_refused(launch("dilys2021", {"--set", "plant.kind=bridge"}),
                 {"bridge.port", "a serial device or udp://HOST:PORT"});
}
TEST_F(BadInput, MissingKey) {
  expect_refused(launch(drive("[rates]\nf_s_Hz = 5000.0\n")),
                 {"drive.toml", "machine.R_s_Ohm", "missing"});
}
TEST_F(BadInput, WrongType) {
  expect_refused(launch(drive("preset = \"dilys2021\"\n[run]\nseed = \"one\"\n")),
                 {"drive.toml:3", "run.seed", "whole number"});
}
TEST_F(BadInput, OutOfRange) {
  expect_refused(launch(drive("preset = \"dilys2021\"\n[rates]\nf_s_Hz = 1.0\n")),
                 {"drive.toml:3", "rates.f_s_Hz", "out of range"});
}
TEST_F(BadInput, RatioThatIsNotWhole) {
  expect_refused(launch(drive("preset = \"dilys2021\"\n[rates]\nf_b_Hz = 1700.0\n")),
                 {"drive.toml:3", "rates.f_b_Hz", "whole number"});
}
TEST_F(BadInput, BrokenToml) {
  expect_refused(launch(drive("name = \"x\n")), {"drive.toml:1"});
}
TEST_F(BadInput, UnknownPreset) {
  expect_refused(launch("dilys2012"), {"dilys2012", "dilys2021"});
  // No other option is needed.
  expect_refused(twinrate({"response", "speed", "dilys2012"}), {"dilys2012", "dilys2021"});
}
TEST_F(BadInput, ADirectoryForAFile) {
  expect_refused(launch(path(".")), {path("."), "plain file"});
}
TEST_F(BadInput, UnknownFilterKind) {
  expect_refused(launch("dilys2021", {"--set", "estimator.kind=ekf"}),
                 {"estimator.kind", "ekf_sensorless"});
}
TEST_F(BadInput, MalformedOverride) {
  expect_refused(launch("dilys2021", {"--set", "rates.n"}), {"--set", "rates.n"});
  expect_refused(launch("dilys2021", {"--set", "rates.n=many"}), {"--set", "rates.n", "many"});
  expect_refused(launch("dilys2021", {"--set", "rates.m=2"}), {"--set", "rates.m"});
}
TEST_F(BadInput, MalformedDuration) {
  expect_refused(twinrate({"launch", "dilys2021", "--duration", "soon", "--run-dir", path("run")}),
                 {"--duration", "soon", "2s"});
  expect_refused(twinrate({"simulate", "dilys2021", "--duration", "-1s", "--run-dir", path("run")}),
                 {"--duration -1s", "0.001"});
}
TEST_F(BadInput, UnknownVerb) {
  expect_refused(twinrate({"lunch", "dilys2021"}), {"lunch"});
}
TEST_F(BadInput, UnknownOption) {
  expect_refused(launch("dilys2021", {"--fast"}), {"--fast"});
}
TEST_F(BadInput, MissingDrive) {
  expect_refused(twinrate({"launch"}), {"DRIVE"});
}
TEST_F(BadInput, UnknownPace) {
  expect_refused(launch("dilys2021", {"--pace", "slow"}), {"--pace", "lockstep"});
}
TEST_F(BadInput, RealtimeWithoutAComputationDelay) {
  expect_refused(launch("dilys2021", {"--pace", "realtime", "--set", "plant.delay_samples=0"}),
                 {"plant.delay_samples", "1 to 4"});
}
TEST_F(BadInput, ChannelSuffixThatIsNoName) {
  expect_refused(launch("dilys2021", {"--channel-suffix", "a.b"}),
                 {"--channel-suffix", "a.b", "letters"});
}

TEST_F(BadInput, LcmUrl) {
  for (const char* url :
       {"foo://x", "udpm://239.255.76.67", "udpm://239.255.76.67:99999", "udpm://nonsense:7667",
        "udpm://10.0.0.1:7667", "udpm://239.255.76.67:7667?color=red", "239.255.76.67:7667"}) {
    SCOPED_TRACE(url);
    expect_refused(launch("dilys2021", {"--lcm-url", url}), {"--lcm-url", url, "udpm://"});
  }
  setenv("LCM_DEFAULT_URL", "nonsense", 1);
  expect_refused(launch("dilys2021"), {"LCM_DEFAULT_URL", "nonsense"});
  unsetenv("LCM_DEFAULT_URL");
}

TEST_F(BadInput, AChildRunAloneSaysItTheSameWay) {
  expect_refused(
      run_program({"twinrate-gain", "--config", "dilys2021", "--set", "estimator.kind=ekf"}, 20),
      {"twinrate-gain", "estimator.kind", "ekf_sensorless"});
  for (const char* program : {"twinrate-plant", "twinrate-estimator", "twinrate-gain",
                              "twinrate-controller", "twinrate-logger"}) {
    SCOPED_TRACE(program);
    expect_refused(run_program({program, "--config", "nothing"}, 20),
                   {program, "nothing", "dilys2021"});
    expect_refused(run_program({program, "--config", "dilys2021", "--lcm-url", "udpm://x"}, 20),
                   {program, "udpm://x"});
    expect_refused(run_program({program}, 20), {program, "--config"});
    expect_refused(run_program({program, "--config", "dilys2021", "--set", "run.seed=-1"}, 20),
                   {program, "run.seed"});
  }
}

TEST_F(BadInput, NoSuchLog) {
  expect_refused(twinrate({"replay", path("nothing.lcm")}), {"nothing.lcm", "no such log"});
  expect_refused(twinrate({"replay", path("")}), {"no log.lcm"});
}

TEST_F(BadInput, LogThatIsNone) {
  write_text(path("text.lcm"), "this is no log");
  expect_refused(twinrate({"replay", path("text.lcm")}), {"text.lcm"});
}

TEST_F(BadInput, LogOfAnotherSchema) {
  {
    lcm::LogFile file(path("log.lcm"), "w");
    manifest_t manifest = make_manifest(1, "", "{}");
    manifest.schema = 999;
    append(file, Channel::kManifest, manifest);
    append(file, Channel::kMeasurement, measurement_t{});
  }
  expect_refused(twinrate({"replay", "--lockstep", path("log.lcm")}), {"log.lcm", "version 999"});
}

TEST_F(BadInput, LogWithMessagesOfAnotherLayout) {
  {
    lcm::LogFile file(path("log.lcm"), "w");
    measurement_t m{};
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(m.getEncodedSize()));
    m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    bytes[3] ^= 1;  // the fingerprint
    append_bytes(file, Channel::kMeasurement, bytes);
  }
  expect_refused(twinrate({"replay", path("log.lcm")}),
                 {"log.lcm", "event ", "byte ", "another type version"});
}

// Nothing can be compared: no line that says "equal".
TEST_F(BadInput, LockstepReplayOfALogWithoutMeasurements) {
  {
    lcm::LogFile file(path("log.lcm"), "w");
    append(file, Channel::kManifest, make_manifest(1, "preset = \"dilys2021\"\n", "{}"));
    append(file, Channel::kCommand, command_t{});
  }
  expect_refused(twinrate({"replay", "--lockstep", path("log.lcm")}),
                 {"log.lcm", "no MEASUREMENT"});
}

TEST_F(BadInput, AnArgumentThatIsNoUtf8AndAPathThatCannotBe) {
  expect_refused(twinrate({"check", "\xff.toml"}), {"\\xff.toml", "UTF-8"});
  expect_refused(twinrate({"check", "a\nb.toml"}), {"a\\x0ab.toml", "no such file"});
  expect_refused(twinrate({"export", path(std::string(300, 'a')), "--format", "csv"}),
                 {"File name too long"});
}

TEST_F(BadInput, ANumberThatIsNone) {
  expect_refused(twinrate({"replay", path("log.lcm"), "--speed", "nan"}), {"--speed", "nan"});
  expect_refused(twinrate({"export", path("log.lcm"), "--format", "csv", "--from", "nan"}),
                 {"--from", "nan"});
}

TEST_F(BadInput, ReplayOptionsThatContradict) {
  expect_refused(twinrate({"replay", path("log.lcm"), "--lockstep", "--speed", "2"}), {"--speed"});
  expect_refused(twinrate({"replay", path("log.lcm"), "--speed", "fast"}), {"--speed"});
}

}  // namespace
}  // namespace twinrate::test

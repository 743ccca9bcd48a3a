// bus.shared_memory: stock LCM tools hear every tick, a process that ends or stops ends the set as over
// UDP, requests arrive, a logger that stops loses nothing, and what does not go with it is refused.
#include <fmt/format.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <set>
#include <thread>

#include "core/bus.hpp"
#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class SharedMemorySet : public SetTest {
 protected:
  std::vector<std::string> launch(const std::string& duration, std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"launch", "dilys2021", "--run-dir", path("run"), "--duration",
                               duration, "--set", "bus.shared_memory=true"});
    return more;
  }
  std::unique_ptr<Program> start(const std::string& duration, std::vector<std::string> more = {}) {
    std::vector<std::string> command = launch(duration, std::move(more));
    command.insert(command.begin(), "twinrate");
    auto program = std::make_unique<Program>(command);
    EXPECT_TRUE(wait_until([&] { return log_size() > 20'000; })) << program->err();
    return program;
  }
  void expect_refused(const std::vector<std::string>& more, const std::string& said) {
    const ProgramResult result = twinrate(launch("0.1s", more), 20);
    EXPECT_EQ(result.exit_code, 2) << said;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_NE(result.err.find("bus.shared_memory: "), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(said), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("run")));
  }
};

// What a stock LCM process hears: channel, sequence number, bytes as of tick_messages(). A message
// that came twice has one place.
class StockListener {
 public:
  StockListener() : lcm_("udpm://239.255.76.67:7667?recv_buf_size=4194304") {
    lcm_.subscribe("DRIVE_.*", &StockListener::receive, this)->setQueueCapacity(0);
    thread_ = std::thread([this] {
      while (!stop_) lcm_.handleTimeout(50);
    });
  }
  ~StockListener() { stop(); }
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  using Messages = std::map<std::pair<std::string, std::int64_t>, std::vector<std::uint8_t>>;
  Messages heard;

 private:
  void receive(const lcm::ReceiveBuffer* buffer, const std::string& channel) {
    const auto* begin = static_cast<const std::uint8_t*>(buffer->data);
    std::vector<std::uint8_t> bytes(begin, begin + buffer->data_size);
    std::int64_t seq = 0;
    for (int i = 8; i < 16; ++i) seq = seq << 8 | bytes[i];
    std::fill_n(bytes.begin() + 24, 8, 0);
    std::fill_n(bytes.end() - 16, 16, 0);
    heard[{channel, seq}] = std::move(bytes);
  }
  lcm::LCM lcm_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

TEST_F(SharedMemorySet, LetsAStockListenerHearEveryTick) {
  StockListener listener;
  const ProgramResult result = twinrate(launch("0.4s"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  listener.stop();
  const std::vector<LoggedMessage> logged = tick_messages(path("run"));
  EXPECT_GT(logged.size(), 5U * 2000);
  for (const LoggedMessage& message : logged)
    ASSERT_EQ(listener.heard[std::make_pair(message.channel, message.seq)], message.bytes)
        << message.channel << "(" << message.seq << ")";
}

class DeadMember : public SharedMemorySet, public ::testing::WithParamInterface<const char*> {};

TEST_P(DeadMember, EndsTheSetWithItsNameAndSignal) {
  const std::string program = GetParam();
  const auto launch = start("600s");
  kill(child(program), SIGKILL);
  const ProgramResult result = launch->wait(8);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find(program + " ended with signal 9"), std::string::npos) << result.err;
  expect_nothing_left();
}

INSTANTIATE_TEST_SUITE_P(System, DeadMember,
                         ::testing::Values("twinrate-plant", "twinrate-gain", "twinrate-controller",
                                           "twinrate-logger"),
                         [](const auto& child) {
                           return std::string(child.param).substr(sizeof "twinrate-" - 1);
                         });

TEST_F(SharedMemorySet, NamesAMemberThatStopsAnswering) {
  const auto launch = start("600s", {"--set", "bus.peer_timeout_s=0.5"});
  kill(child("twinrate-estimator"), SIGSTOP);
  const ProgramResult result = launch->wait(15);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_NE(result.err.find("estimator stopped answering"), std::string::npos) << result.err;
  expect_nothing_left();
}

TEST_F(SharedMemorySet, IsGoneWithItsSupervisor) {
  const auto launch = start("600s");
  launch->signal(SIGKILL);
  expect_nothing_left();
}

TEST_F(SharedMemorySet, TakesRequestsAndEndsCleanlyOnCtrlC) {
  const auto launch = start("600s");
  const ProgramResult set = twinrate({"set", "n=3", "--run-dir", path("run")});
  EXPECT_EQ(set.exit_code, 0) << set.err;
  launch->signal_group(SIGINT);
  const ProgramResult result = launch->wait(8);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_NE(result.out.find("interrupted"), std::string::npos) << result.out;
  expect_nothing_left();
  const RunLog log = read_run_log(path("run"), "", OnDamage::kRefuse);
  for (std::size_t i = 0; i < log.command.size(); ++i)
    ASSERT_EQ(log.command[i].k, static_cast<std::int64_t>(i));
}

TEST_F(SharedMemorySet, SendsItsCopiesFromOneSocket) {
  Bus bus({});
  std::set<SocketName> senders;
  bus.subscribe<measurement_t>([&](const measurement_t&) { senders.insert(bus.sender()); });
  bus.subscribe<estimate_t>([&](const estimate_t&) { senders.insert(bus.sender()); });
  bus.subscribe<command_t>([&](const command_t&) { senders.insert(bus.sender()); });
  ASSERT_EQ(twinrate(launch("0.1s")).exit_code, 0);
  while (bus.handle(0)) {
  }
  EXPECT_EQ(senders.size(), 1U) << "the logger sends all";
}

TEST_F(SharedMemorySet, LosesNothingWhereTheLoggerStopsForAWholeWindow) {
  constexpr int kTicks = 4000, kWindow = 1024;
  Bus bus({});
  std::int64_t plant_at = -1, before = -1;
  bus.subscribe<status_t>([&](const status_t& status) {
    if (status.role != static_cast<int>(Role::kPlant)) return;
    before = plant_at;
    plant_at = status.seq;
  });
  const auto launch =
      start("0.8s", {"--pace", "wall", "--set", fmt::format("bus.window_ticks={}", kWindow)});
  const pid_t logger = child("twinrate-logger");
  kill(logger, SIGSTOP);
  EXPECT_TRUE(
      wait_until([&] { return bus.handle(10), plant_at >= kWindow - 1 && plant_at == before; }));
  EXPECT_LT(plant_at, kTicks - 1) << "it never waited";
  kill(logger, SIGCONT);
  const ProgramResult result = launch->wait(30);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::vector<std::string> simulate = {"simulate",       "dilys2021",  "--run-dir",
                                             path("simulate"), "--duration", "0.8s"};
  ASSERT_EQ(twinrate(simulate).exit_code, 0);
  EXPECT_TRUE(same_messages(path("run"), path("simulate"), kTicks));
}

TEST_F(SharedMemorySet, IsRefusedWhereAProcessHasNoPartInTheMemory) {
  expect_refused({"--pace", "realtime"}, "lockstep, wall allowed for --pace, found realtime");
  expect_refused({"--without", "gain"}, "--without");
  expect_refused({"--own", "gain=true"}, "--own");
  expect_refused({"--print-pmd"}, "--print-pmd");
  expect_refused({"--set", "bus.split_ports=true"}, "bus.split_ports");
  expect_refused({"--set", "bus.window_ticks=1025"}, "bus.window_ticks up to 1024");
  expect_refused({"--set", "plant.kind=bridge", "--set", "bridge.emulate=true"},
                 "plant.kind = simulated");
  for (const char* url : {"mpudpm://239.255.76.67:7667", "tcpq://127.0.0.1:7700", "memq://"})
    expect_refused({"--lcm-url", url}, "udpm://ADDRESS:PORT, found " + std::string(url));
}

}  // namespace
}  // namespace twinrate::test

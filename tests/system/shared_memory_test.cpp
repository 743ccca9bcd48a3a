// bus.shared_memory: stock LCM tools hear every tick, a process that ends or stops ends the set as over
// UDP, requests arrive, a logger that was lapped loses nothing, and what does not go with it is refused.
#include <atomic>
#include <csignal>
#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <thread>

#include "core/bus.hpp"
#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class SharedMemorySet : public ProgramTest {
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
  std::uintmax_t log_size() const {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path("run") + "/log.lcm", error);
    return error ? 0 : size;
  }
  pid_t child(const std::string& program) const {
    const std::vector<pid_t> found = processes_with(path("run"), program);
    EXPECT_EQ(found.size(), 1u) << program;
    return found.size() == 1 ? found.front() : 0;
  }
  void expect_nothing_left() {
    EXPECT_TRUE(wait_until([&] { return processes_with(path("run")).empty(); }, 2));
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

// The bytes that a stock LCM process hears.
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
  std::map<std::string, std::vector<std::vector<std::uint8_t>>> heard;

 private:
  void receive(const lcm::ReceiveBuffer* buffer, const std::string& channel) {
    const auto* bytes = static_cast<const std::uint8_t*>(buffer->data);
    heard[channel].emplace_back(bytes, bytes + buffer->data_size);
  }
  lcm::LCM lcm_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

TEST_F(SharedMemorySet, LetsAStockListenerHearEveryTickInItsOrder) {
  StockListener listener;
  const ProgramResult result = twinrate(launch("0.4s"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  listener.stop();
  std::map<std::string, std::vector<std::vector<std::uint8_t>>> logged;
  for (LoggedMessage& message : tick_messages(path("run")))
    logged[message.channel].push_back(std::move(message.bytes));
  ASSERT_EQ(logged.size(), 6u);
  for (const auto& [channel, messages] : logged) {
    std::vector<std::vector<std::uint8_t>>& copies = listener.heard[channel];
    for (std::vector<std::uint8_t>& copy : copies) std::fill_n(copy.begin() + 24, 8, 0);  // session
    EXPECT_EQ(copies.size(), messages.size()) << channel;
    EXPECT_TRUE(copies == messages) << channel;
  }
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

// A window that is larger than the ring: the messages that were overwritten come again.
TEST_F(SharedMemorySet, LosesNothingWhereTheLoggerIsLapped) {
  constexpr int kTicks = 2500;
  Bus bus({});
  std::int64_t plant_at = 0;
  bus.subscribe<status_t>([&](const status_t& status) {
    if (status.role == static_cast<int>(Role::kPlant)) plant_at = status.seq;
  });
  const auto launch =
      start("0.5s", {"--pace", "wall", "--set", "bus.window_ticks=8192", "--set", "rates.n=5"});
  const pid_t logger = child("twinrate-logger");
  kill(logger, SIGSTOP);
  EXPECT_TRUE(wait_until([&] { return bus.handle(10), plant_at >= kTicks - 1; }));
  kill(logger, SIGCONT);
  const ProgramResult result = launch->wait(30);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("lost"), std::string::npos) << result.out;
  ASSERT_EQ(twinrate({"simulate", "dilys2021", "--run-dir", path("simulate"), "--duration", "0.5s"})
                .exit_code,
            0);
  EXPECT_TRUE(same_messages(path("run"), path("simulate"), kTicks));
}

TEST_F(SharedMemorySet, IsRefusedWhereAProcessHasNoPartInTheMemory) {
  expect_refused({"--pace", "realtime"}, "lockstep, wall allowed for --pace, found realtime");
  expect_refused({"--without", "gain"}, "--without");
  expect_refused({"--own", "gain=true"}, "--own");
  expect_refused({"--set", "bus.split_ports=true"}, "bus.split_ports");
  expect_refused({"--set", "plant.kind=bridge", "--set", "bridge.emulate=true"},
                 "plant.kind = simulated");
  for (const char* url : {"mpudpm://239.255.76.67:7667", "tcpq://127.0.0.1:7700", "memq://"})
    expect_refused({"--lcm-url", url}, "udpm://ADDRESS:PORT, found " + std::string(url));
}

}  // namespace
}  // namespace twinrate::test

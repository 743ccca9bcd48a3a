// The bus's own sockets beside stock LCM: liblcm hears the bus and the bus hears liblcm, messages of
// any size; foreign datagrams are counted; the kernel filter lets through what is wanted.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <lcm/lcm-cpp.hpp>
#include <map>
#include <set>
#include <thread>

#include "core/bus.hpp"
#include "core/manifest.hpp"
#include "core/multicast.hpp"
#include "model/signals.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

constexpr std::int64_t kBusSession = 11;
constexpr std::size_t kSeveralDatagrams = 300'000;

manifest_t large_manifest() {
  return make_manifest(kBusSession, std::string(kSeveralDatagrams, 'x'), "{}");
}

class BusSockets : public ProgramTest {
 protected:
  static BusOptions options() { return {.session = kBusSession}; }
};

TEST_F(BusSockets, HearMessagesOfAnySizeFromLiblcm) {
  Bus bus(options());
  std::string heard;
  int commands = 0;
  bus.subscribe<manifest_t>([&](const manifest_t& m) { heard = m.config_toml; });
  bus.subscribe<command_t>([&](const command_t&) { ++commands; });
  lcm::LCM stock;
  command_t command{};
  command.session = kBusSession;
  stock.publish("DRIVE_COMMAND", &command);
  const manifest_t manifest = large_manifest();
  stock.publish("DRIVE_MANIFEST", &manifest);
  ASSERT_TRUE(wait_until([&] { return bus.handle(10), !heard.empty(); }));
  EXPECT_EQ(heard, manifest.config_toml);
  EXPECT_EQ(commands, 1);
  EXPECT_EQ(bus.counters().undecodable, 0);
}

TEST_F(BusSockets, ThatSpinHearWhatComesWhileTheySpinAndAfterwards) {
  BusOptions spinning = options();
  spinning.spin_us = 20'000;
  Bus bus(spinning), other(options());
  int commands = 0;
  bus.subscribe<command_t>([&](const command_t&) { ++commands; });
  command_t command{};
  for (const int pause_ms : {5, 60}) {
    std::thread sender([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
      other.publish(command);
    });
    EXPECT_TRUE(bus.handle(5000)) << pause_ms;
    sender.join();
  }
  EXPECT_EQ(commands, 2);
  EXPECT_FALSE(bus.handle(30)) << "nothing comes: the time-out ends it";
}

TEST_F(BusSockets, StockLoggerRecordsWhatTheBusSendsAndStockPlayerFeedsIt) {
  constexpr int kCommands = 10;  // its queue holds 30 messages and drops the newest
  Program logger({"lcm-logger", "--lcm-url=udpm://239.255.76.67:7667?recv_buf_size=4194304",
                  path("stock.lcm")});
  Bus bus(options());
  const auto recorded = [&] {
    std::map<std::string, int> count;
    std::size_t manifest_size = 0;
    lcm::LogFile file(path("stock.lcm"), "r");
    while (file.good()) {
      const lcm::LogEvent* event = file.readNextEvent();
      if (!event) break;
      ++count[event->channel];
      if (event->channel == "DRIVE_MANIFEST")
        manifest_size = static_cast<std::size_t>(event->datalen);
    }
    return std::make_pair(count, manifest_size);
  };
  // The logger may still be starting: events until it has written one.
  event_t event{};
  event.seq = -1;
  event.waited_for = -1;
  ASSERT_TRUE(wait_until([&] {
    event.text = std::string(8000, '.');  // fills the buffer of its file
    bus.publish(event);
    bus.handle(5);
    return access(path("stock.lcm").c_str(), R_OK) == 0 && recorded().first["DRIVE_EVENT"] > 0;
  }));
  for (int k = 0; k < kCommands; ++k) {
    command_t command{};
    command.seq = k;
    reference_t reference{};
    reference.seq = k;
    bus.publish(reference, command);
    bus.handle(0);
  }
  const manifest_t manifest = large_manifest();
  bus.publish(manifest);
  ASSERT_TRUE(wait_until([&] {
    bus.publish(event);
    bus.handle(5);
    return recorded().second > 0;
  }));
  logger.signal(SIGINT);
  logger.wait(10);
  const auto [count, manifest_size] = recorded();
  EXPECT_EQ(count.at("DRIVE_COMMAND"), kCommands);
  EXPECT_EQ(count.at("DRIVE_REFERENCE"), kCommands);
  EXPECT_EQ(manifest_size, static_cast<std::size_t>(manifest.getEncodedSize()));

  Bus listener({.follow = true});
  std::set<std::int64_t> played;
  std::string config;
  listener.subscribe<command_t>([&](const command_t& c) { played.insert(c.seq); });
  listener.subscribe<manifest_t>([&](const manifest_t& m) { config = m.config_toml; });
  Program player({"lcm-logplayer", "-e", "DRIVE_(COMMAND|MANIFEST)", path("stock.lcm")});
  EXPECT_TRUE(wait_until(
      [&] { return listener.handle(10), played.size() == kCommands && !config.empty(); }));
  EXPECT_EQ(config, manifest.config_toml);
}

// The gain process of a replay had not heard of the next one yet: its heartbeat took the estimator back to
// the session before, and the filter restarted twice.
TEST_F(BusSockets, WhoFollowsIsNotTakenBackToASessionByALateAnswer) {
  Bus bus({.follow = true});
  std::vector<std::int64_t> heard;
  int sessions = 0, answers = 0;
  bus.subscribe<measurement_t>([&](const measurement_t& m) { heard.push_back(m.seq); });
  bus.subscribe<gain_t>([&](const gain_t&) { ++answers; });
  bus.subscribe<status_t>([&](const status_t&) { ++answers; });
  bus.on_new_session([&] { ++sessions; });
  lcm::LCM stock;
  const auto measure = [&](std::int64_t session, std::int64_t k) {
    measurement_t m{};
    m.session = session;
    m.seq = k;
    stock.publish("DRIVE_MEASUREMENT", &m);
  };
  measure(kBusSession, 0);
  measure(kBusSession + 1, 1);
  gain_t gain{};
  gain.n_x = gain.n_y = gain.n_K = gain.n_P = 1;
  gain.K = gain.P = {1.0};
  gain.session = kBusSession;
  stock.publish("DRIVE_GAIN", &gain);
  status_t status{};
  status.session = kBusSession;
  stock.publish("DRIVE_STATUS", &status);
  measure(kBusSession + 1, 2);
  ASSERT_TRUE(wait_until([&] { return bus.handle(10), heard.size() == 3; }));
  EXPECT_EQ(bus.session(), kBusSession + 1);
  EXPECT_EQ(sessions, 1);
  EXPECT_EQ(answers, 0);
  EXPECT_EQ(bus.counters().refused, 2);
}

TEST_F(BusSockets, ForeignDatagramsAreCountedAndNothingElse) {
  Bus bus(options());
  int commands = 0;
  bus.subscribe<command_t>([&](const command_t&) { ++commands; });
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  inet_pton(AF_INET, kDefaultMulticastAddress, &to.sin_addr);
  const int out = socket(AF_INET, SOCK_DGRAM, 0);
  const std::vector<std::string> foreign = {
      "x",
      "GET / HTTP/1.1",
      std::string("LC03\xff\xff\xff\xff\xff\xff\xff\xff", 12),
      std::string("LC03\0\0\0\1\x7f\xff\xff\xff\0\0\0\0\0\0\xff\xff", 20),
      "LC02 and no end of the channel",
      std::string(65000, 'L')};
  for (const std::string& datagram : foreign)
    sendto(out, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&to),
           sizeof to);
  close(out);
  bus.publish(command_t{});
  EXPECT_TRUE(wait_until([&] { return bus.handle(10), commands == 1; }));
  // The filter in the kernel has dropped the shortest, and the one that begins as a whole message.
  EXPECT_EQ(bus.counters().undecodable, static_cast<std::int64_t>(foreign.size()) - 2);
}

// Two sets on one URL: the ticks of the other would wake every process.
TEST_F(BusSockets, TheKernelDropsTheTicksOfAnotherSession) {
  for (const bool filter : {true, false})
    for (const std::int64_t session : {kBusSession, kBusSession + (std::int64_t{1} << 40)}) {
      BusOptions o = options();
      o.filter = filter;
      o.session = session;
      Bus bus(o), same_half({.session = session ^ (std::int64_t{1} << 32)}),
          other_half({.session = session + 1});
      int commands = 0, estimates = 0;
      bool end = false;
      bus.subscribe<estimate_t>([&](const estimate_t&) { ++estimates; });
      bus.want_estimates({10});
      bus.subscribe<command_t>([&](const command_t&) { ++commands; });
      bus.subscribe<event_t>([&](const event_t&) { end = true; });
      for (Bus* sender : {&same_half, &other_half, &bus})
        sender->publish(estimate_t{}, command_t{}, event_t{});
      EXPECT_TRUE(wait_until([&] { return bus.handle(10), end; }));
      EXPECT_EQ(commands, 1);
      EXPECT_EQ(estimates, 1);
      EXPECT_EQ(bus.counters().refused, filter ? 2 : 6) << "events alone, or all";
    }
}

class ThinnedEstimates : public BusSockets {
 protected:
  std::set<std::int64_t> heard(const std::vector<BackgroundRate>& wanted, bool filter) {
    BusOptions o = options();
    o.filter = filter;
    Bus bus(o);
    std::set<std::int64_t> seen;
    bus.subscribe<estimate_t>([&](const estimate_t& e) { seen.insert(e.seq); });
    for (const BackgroundRate& rate : wanted) bus.want_estimates(rate);
    bool end = false;
    bus.subscribe<command_t>([&](const command_t&) { end = true; });
    for (std::int64_t k = 0; k < 30; ++k) {
      if (k == kLost - first_k_) continue;
      estimate_t estimate{};
      estimate.seq = first_k_ + k;
      estimate.status = k == 7 ? kGainEveryTick | kLateGain : kLateGain;
      bus.publish(estimate);
    }
    estimate_t last{};
    last.seq = first_k_ + 30;
    bus.publish(last, command_t{});
    EXPECT_TRUE(wait_until([&] { return bus.handle(10), end; }));
    gaps_ = bus.counters().gaps;
    return seen;
  }
  std::int64_t gaps_ = 0, first_k_ = 0;
  static constexpr std::int64_t kLost = 20;
};

TEST_F(ThinnedEstimates, AreSnapshotsAndThoseThatAskForAGain) {
  EXPECT_EQ(heard({{10}}, true), (std::set<std::int64_t>{0, 7, 10, 30}));
  EXPECT_EQ(gaps_, 1) << "20, and none that is not wanted";
  EXPECT_EQ(heard({{10, 3}}, true), (std::set<std::int64_t>{0, 1, 2, 7, 10, 30}));
  EXPECT_EQ(heard({{10}, {15}}, true), (std::set<std::int64_t>{0, 5, 7, 10, 15, 25, 30}));
  EXPECT_EQ(gaps_, 1);
}

// The kernel's filter divides 32 bits: 9.9 days at 5 kHz.
TEST_F(ThinnedEstimates, AreTheSameBeyond32BitsOfTicks) {
  for (const std::int64_t end : {std::int64_t{1} << 32, std::int64_t{5} << 32}) {
    first_k_ = end - 15;
    std::set<std::int64_t> expected = {first_k_ + 7};
    for (std::int64_t k = first_k_; k <= first_k_ + 30; ++k)
      if (k % 10 == 0) expected.insert(k);
    EXPECT_EQ(heard({{10}}, true), expected) << end;
    EXPECT_EQ(gaps_, 0);
  }
}

TEST_F(ThinnedEstimates, WithoutTheFilterAllArrive) {
  EXPECT_EQ(heard({{10}}, false).size(), 30u);
}

TEST_F(BusSockets, QuietMessagesAreHandledBeforeTheOneThatWakes) {
  Bus bus(options());
  std::vector<std::string> order;
  bus.subscribe<measurement_t>([&](const measurement_t&) { order.push_back("measurement"); },
                               Wake::kQuiet);
  bus.subscribe<estimate_t>([&](const estimate_t&) { order.push_back("estimate"); });
  bus.publish(measurement_t{}, measurement_t{});
  bus.publish(estimate_t{});
  EXPECT_TRUE(wait_until([&] { return bus.handle(20), order.size() == 3; }));
  EXPECT_EQ(order, (std::vector<std::string>{"measurement", "measurement", "estimate"}));
  order.clear();
  bus.wake_for_all(true);
  bus.publish(measurement_t{});
  EXPECT_TRUE(bus.handle(5000));
  EXPECT_EQ(order.size(), 1u);
}

TEST_F(BusSockets, ABusThatDrainsLosesNothing) {
  BusOptions o = options();
  o.drain_every_ms = 1;
  Bus bus(o);
  std::int64_t count = 0;
  bus.subscribe<command_t>([&](const command_t&) { ++count; });
  constexpr std::int64_t kBurst = 2000;
  for (std::int64_t k = 0; k < kBurst; ++k) {
    command_t command{};
    command.seq = k;
    bus.publish(command);
  }
  while (bus.handle(20)) {
  }
  EXPECT_EQ(count, kBurst);
  EXPECT_EQ(bus.counters().gaps, 0);
}

}  // namespace
}  // namespace twinrate::test

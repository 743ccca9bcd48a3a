// The bus in one process (memq://): what counts as a gap, and a request that comes too late.
#include "core/bus.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <deque>
#include <filesystem>
#include <fstream>
#include <thread>

#include "core/output_file.hpp"
#include "core/process.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::bus_test {
namespace {

constexpr std::int64_t kSession = 7;

// Hears what it publishes itself.
class Echo {
 public:
  explicit Echo(const DriveConfig& drive)
      : bus_({.url = "memq://", .session = kSession, .gains_between = [drive](auto a, auto b) {
                return drive.gains_between(a, b);
              }}) {
    bus_.subscribe<measurement_t>([](const measurement_t&) {});
    bus_.subscribe<gain_t>([](const gain_t&) {});
  }
  template <class Wire>
  void publish(std::int64_t k) {
    Wire wire{};
    wire.seq = k;
    bus_.publish(wire);
    while (bus_.handle(0)) {
    }
  }
  std::int64_t gaps() const { return bus_.counters().gaps; }

 private:
  Bus bus_;
};

TEST(BusGaps, MessagesOneAfterTheOtherAreNone) {
  Echo echo(test::drive_of("dilys2021", {"rates.n=5"}));
  for (std::int64_t k = 3; k < 40; ++k) {
    echo.publish<measurement_t>(k);
    if (k % 5 == 0) echo.publish<gain_t>(k);
  }
  EXPECT_EQ(echo.gaps(), 0);
}

TEST(BusGaps, AreTheMessagesThatAreMissing) {
  Echo echo(test::drive_of("dilys2021", {"rates.n=5"}));
  for (std::int64_t k : {0, 1, 5, 6}) echo.publish<measurement_t>(k);
  EXPECT_EQ(echo.gaps(), 3);
  for (std::int64_t k : {0, 5, 20}) echo.publish<gain_t>(k);  // without 10 and 15
  EXPECT_EQ(echo.gaps(), 5);
}

TEST(BusGaps, ChangeNotWhereAMessageIsSentAgain) {
  Echo echo(test::drive_of("dilys2021"));
  for (std::int64_t k : {0, 1, 2, 3, 1, 2, 3, 4}) echo.publish<measurement_t>(k);
  EXPECT_EQ(echo.gaps(), 0);
}

// Realtime: whoever believed one message of a far tick would refuse those in between as old.
TEST(BusJumps, AFarTickIsBelievedAtTheSecondMessageAndNotAtTheFirst) {
  Bus bus({.url = "memq://", .session = kSession, .max_jump = 50});
  std::vector<std::int64_t> heard;
  bus.subscribe<measurement_t>([&](const measurement_t& m) { heard.push_back(m.seq); });
  const auto publish = [&](std::initializer_list<std::int64_t> ticks) {
    heard.clear();
    for (const std::int64_t k : ticks) {
      measurement_t wire{};
      wire.seq = k;
      bus.publish(wire);
      while (bus.handle(0)) {
      }
    }
    return heard;
  };
  using Ticks = std::vector<std::int64_t>;
  EXPECT_EQ(publish({1000, 1001}), (Ticks{1000, 1001})) << "a process that begins late";
  EXPECT_EQ(publish({5000, 1002, 1003, 5000, 1004}), (Ticks{1002, 1003, 1004}));
  EXPECT_EQ(bus.counters().refused, 2);
  EXPECT_EQ(publish({1054, 1105, 1106}), (Ticks{1054, 1106})) << "a hole of 50";
  EXPECT_EQ(publish({1107, 1104}), (Ticks{1107, 1104})) << "sent again";
}

// ARCHITECTURE.md, what switches the drive off. In lock-step no tick is far.
TEST(BusJumps, AProcessInRealtimeRefusesAMessageMoreThanFiftyTicksAhead) {
  for (const Pace pace : {Pace::kRealtime, Pace::kLockstep}) {
    Process process({Role::kController, "test", ""},
                    {.config = "dilys2021", .url = "memq://", .session = kSession, .pace = pace});
    std::vector<std::int64_t> heard;
    process.bus().subscribe<measurement_t>([&](const measurement_t& m) { heard.push_back(m.seq); });
    for (const std::int64_t k : {0, 51, 1, 52, 53}) {
      measurement_t wire{};
      wire.seq = k;
      process.bus().publish(wire);
      while (process.bus().handle(0)) {
      }
    }
    using Ticks = std::vector<std::int64_t>;
    EXPECT_EQ(heard, pace == Pace::kRealtime ? (Ticks{0, 1, 53}) : (Ticks{0, 51, 1, 52, 53}));
  }
}

// Of GAIN the gains count, not the ticks. The logger believed a forged one of a far tick and took the
// genuine ones after it for messages that it had.
TEST(BusJumps, AGainIsFarByTheGainsBetween) {
  Bus bus(
      {.url = "memq://",
       .session = kSession,
       .gains_between = [](std::int64_t first, std::int64_t last) { return (last - first) / 5; },
       .max_jump = 50});
  std::vector<std::int64_t> heard;
  bus.subscribe<gain_t>([&](const gain_t& gain) { heard.push_back(gain.seq); });
  for (const std::int64_t k : {1000, 1005, 6000, 1010, 1260, 1515, 1520}) {
    gain_t wire{};
    wire.seq = k;
    wire.n_x = wire.n_y = 1;
    wire.n_K = wire.n_P = 1;
    wire.K = wire.P = {1.0};
    bus.publish(wire);
    while (bus.handle(0)) {
    }
  }
  EXPECT_EQ(heard, (std::vector<std::int64_t>{1000, 1005, 1010, 1260, 1520}));
  EXPECT_EQ(bus.counters().refused, 2);
}

TEST(BusMalformed, IsCountedAndNeverHeard) {
  Bus bus({.url = "memq://", .session = kSession, .ticks = 100});
  int heard = 0;
  bus.subscribe<status_t>([&](const status_t&) { ++heard; });
  bus.subscribe<event_t>([&](const event_t&) { ++heard; });
  bus.subscribe<gain_t>([&](const gain_t&) { ++heard; });
  const auto send = [&](const auto& wire) {
    bus.publish(wire);
    while (bus.handle(0)) {
    }
  };
  status_t unknown_role{};
  unknown_role.role = 99;
  send(unknown_role);
  event_t not_utf8{};
  not_utf8.waited_for = -1;
  not_utf8.text = "\xff\xfe";
  send(not_utf8);
  gain_t wrong_size{};
  wrong_size.n_x = 3;
  wrong_size.n_y = 2;
  send(wrong_size);
  EXPECT_EQ(bus.counters().undecodable, 3);
  gain_t beyond_the_run{};
  beyond_the_run.seq = 100;
  send(beyond_the_run);
  EXPECT_EQ(bus.counters().refused, 1);
  EXPECT_EQ(heard, 0);
  beyond_the_run.seq = 99;
  send(beyond_the_run);
  EXPECT_EQ(heard, 1);
}

class Tagged : public ::testing::Test {
 public:
  Tagged() : token_((directory_ / "token").string()) {}
  ~Tagged() override { std::filesystem::remove_all(directory_); }
  static std::filesystem::path fresh_directory() {
    std::string name = (std::filesystem::temp_directory_path() / "twinrate-tag-XXXXXX").string();
    return mkdtemp(name.data());
  }
  BusOptions options(bool authenticate = true) const {
    return {.url = "memq://",
            .session = kSession,
            .token_file = token_.path(),
            .authenticate = authenticate};
  }
  std::filesystem::path directory_ = fresh_directory();
  TokenFile token_;
};

TEST_F(Tagged, MessagesOfTheTokenAreHeardAndNoOthers) {
  Bus bus(options());
  int heard = 0, requests = 0;
  bus.subscribe<command_t>([&](const command_t& c) {
    ++heard;
    EXPECT_NE(c.tag, 0);
    EXPECT_GT(c.host_ns, 0);
  });
  bus.on_untagged_request([&] { ++requests; });
  bus.subscribe<request_t>([](const request_t&) { ADD_FAILURE(); });
  bus.publish(command_t{});
  while (bus.handle(0)) {
  }
  EXPECT_EQ(heard, 1);
  EXPECT_EQ(bus.counters().refused, 0);

  std::vector<std::uint8_t> genuine(static_cast<std::size_t>(command_t{}.getEncodedSize()));
  command_t command{};
  command.session = kSession;
  command.encode(genuine.data(), 0, static_cast<int>(genuine.size()));
  Tagger tagger(read_token(token_.path())), other({1, 2, 3});
  tagger.put("DRIVE_COMMAND", genuine.data(), genuine.size());
  EXPECT_TRUE(tagger.is_genuine("DRIVE_COMMAND", genuine.data(), genuine.size()));
  EXPECT_FALSE(tagger.is_genuine("DRIVE_ESTIMATE", genuine.data(), genuine.size()));
  EXPECT_FALSE(other.is_genuine("DRIVE_COMMAND", genuine.data(), genuine.size()));
  for (std::size_t i = 0; i < genuine.size(); ++i) {
    std::vector<std::uint8_t> changed = genuine;
    changed[i] ^= 0x10;
    EXPECT_FALSE(tagger.is_genuine("DRIVE_COMMAND", changed.data(), changed.size())) << i;
  }
  EXPECT_FALSE(tagger.is_genuine("DRIVE_COMMAND", genuine.data(), 7));
}

TEST_F(Tagged, WithoutAuthenticationEveryMessageIsHeard) {
  Bus bus(options(false));
  int heard = 0;
  bus.subscribe<command_t>([&](const command_t&) { ++heard; });
  bus.publish(command_t{});
  while (bus.handle(0)) {
  }
  EXPECT_EQ(heard, 1);
}

// liblcm's provider of files empties the file of mode=w.
TEST(BusUrl, NoUrlNamesAFile) {
  const std::string file = testing::TempDir() + "twinrate-url-" + std::to_string(getpid());
  std::ofstream(file) << "mine";
  for (const std::string& url : {"file://" + file + "?mode=w", "file://" + file})
    EXPECT_THROW(Bus({.url = url, .session = 1}), BadInput) << url;
  EXPECT_EQ(std::filesystem::file_size(file), 4u);
  std::filesystem::remove(file);
}

TEST_F(Tagged, APipeIsNoToken) {
  const std::string pipe = testing::TempDir() + "twinrate-pipe-" + std::to_string(getpid());
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THROW(read_token(pipe), BadInput);
  std::filesystem::remove(pipe);
}

TEST_F(Tagged, ATokenIsReadFromItsOwnersFileAlone) {
  EXPECT_EQ(read_token(token_.path()), read_token(token_.path()));
  EXPECT_THROW(TokenFile(token_.path()), BadInput) << "not overwritten";
  std::filesystem::permissions(token_.path(), std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_THROW(read_token(token_.path()), BadInput);
  EXPECT_THROW(read_token((directory_ / "none").string()), BadInput);
  const std::string none = (directory_ / "text").string();
  write_new(none, "not a token\n");
  std::filesystem::permissions(none, std::filesystem::perms::owner_read);
  EXPECT_THROW(read_token(none), BadInput);
}

TEST_F(Tagged, WhoFindsTheFileFindsTheWholeToken) {
  constexpr int kFiles = 200;
  const auto path = [&](int i) { return (directory_ / std::to_string(i)).string(); };
  std::thread reader([&] {
    for (int i = 0; i < kFiles; ++i) {
      while (!std::filesystem::exists(path(i))) {
      }
      EXPECT_NO_THROW(read_token(path(i))) << i;
    }
  });
  {
    std::deque<TokenFile> files;
    for (int i = 0; i < kFiles; ++i) files.emplace_back(path(i));
    reader.join();
  }
  const std::filesystem::directory_iterator files(directory_);
  EXPECT_EQ(std::distance(begin(files), end(files)), 1) << "the token of this test";
}

// Without a session: in a launched set the plant decides on the tick.
TEST(AddEffect, AskedForTooLateAppliesAtTheNextTickAndTheReplySaysWhich) {
  Process process({Role::kEstimator, "test", ""}, {.config = "dilys2021", .url = "memq://"});
  std::vector<std::int64_t> applied, replied;
  process.on_new_model([&](Config&) { return [&](std::int64_t k) { applied.push_back(k); }; });
  process.bus().subscribe<reply_t>([&](const reply_t& r) { replied.push_back(r.applied_seq); });
  process.ready();
  process.progress(100);
  for (const double wanted : {40.0, 250.0}) {
    request_t request{};
    request.seq = static_cast<std::int64_t>(wanted);
    request.kind = static_cast<std::int32_t>(RequestKind::kAddEffect);
    request.value = wanted;
    request.text =
        "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.01\nused_in = \"model\"\n";
    process.bus().publish(request);
    while (process.bus().handle(0)) {
    }
  }
  EXPECT_EQ(applied, (std::vector<std::int64_t>{101, 250}));
  EXPECT_EQ(replied, applied);
}

// In realtime: the process goes on with its ticks meanwhile, and answers when the model is there.
TEST(AddEffect, IsBuiltBesideTheTicksInRealtime) {
  Process process({Role::kEstimator, "test", ""},
                  {.config = "dilys2021", .url = "memq://", .pace = Pace::kRealtime});
  std::atomic<bool> may_go_on = false;
  std::thread::id built_on;
  std::vector<std::int64_t> applied;
  std::vector<reply_t> replies;
  process.on_new_model([&](Config&) {
    built_on = std::this_thread::get_id();
    may_go_on.wait(false);
    return [&](std::int64_t k) { applied.push_back(k); };
  });
  process.bus().subscribe<reply_t>([&](const reply_t& r) { replies.push_back(r); });
  process.ready();
  const auto ask = [&](RequestKind kind, double value, const std::string& text) {
    request_t request{};
    request.seq = 7;
    request.kind = static_cast<std::int32_t>(kind);
    request.value = value;
    request.text = text;
    process.bus().publish(request);
    while (process.bus().handle(0)) {
    }
  };
  const auto prepare = [&] {
    ask(RequestKind::kPrepare, static_cast<double>(RequestKind::kAddEffect),
        "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.01\nused_in = \"model\"\n");
  };
  prepare();
  prepare();  // as the plant repeats it
  ask(RequestKind::kApplyAt, 250, "");
  process.progress(100);
  EXPECT_TRUE(replies.empty());
  EXPECT_TRUE(applied.empty());
  may_go_on = true;
  may_go_on.notify_all();
  while (replies.empty()) process.turn(1);
  EXPECT_NE(built_on, std::this_thread::get_id());
  EXPECT_EQ(replies[0].accepted, 1);
  ask(RequestKind::kApplyAt, 250, "");
  EXPECT_EQ(applied, std::vector<std::int64_t>{250});
}

// The drive may be on its way when a request is repeated.
TEST(ResetRequest, ThatComesAgainGetsItsFirstAnswer) {
  Process process({Role::kEstimator, "test", ""}, {.config = "dilys2021", .url = "memq://"});
  std::vector<std::int64_t> applied, replied;
  process.on_reset([&](std::int64_t k) {
    applied.push_back(k);
    return std::string();
  });
  process.bus().subscribe<reply_t>([&](const reply_t& r) { replied.push_back(r.applied_seq); });
  process.ready();
  for (const std::int64_t k : {100, 200}) {
    process.progress(k);
    request_t request{};
    request.seq = 7;
    request.kind = static_cast<std::int32_t>(RequestKind::kReset);
    process.bus().publish(request);
    while (process.bus().handle(0)) {
    }
  }
  EXPECT_EQ(applied, std::vector<std::int64_t>{101});
  EXPECT_EQ(replied, (std::vector<std::int64_t>{101, 101}));
}

TEST(RemoveEffect, TakesOutWhatWasAddedAndNothingElse) {
  Process process({Role::kEstimator, "test", ""}, {.config = "dilys2021", .url = "memq://"});
  const std::size_t declared = process.config().drive().effects.size();
  std::vector<std::size_t> effects;  // of the model, at each change
  std::vector<reply_t> replies;
  process.on_new_model([&](Config& model) {
    return [&, count = model.drive().effects.size() - declared](std::int64_t) {
      effects.push_back(count);
    };
  });
  process.bus().subscribe<reply_t>([&](const reply_t& r) { replies.push_back(r); });
  process.ready();
  const std::string friction =
      "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.01\nused_in = \"model\"\n";
  std::int64_t number = 1;
  for (const RequestKind kind : {RequestKind::kRemoveEffect, RequestKind::kAddEffect,
                                 RequestKind::kRemoveEffect, RequestKind::kRemoveEffect}) {
    request_t request{};
    request.seq = number++;
    request.kind = static_cast<std::int32_t>(kind);
    request.value = 250;
    request.text = friction;
    process.bus().publish(request);
    while (process.bus().handle(0)) {
    }
  }
  EXPECT_EQ(effects, (std::vector<std::size_t>{1, 0}));
  ASSERT_EQ(replies.size(), 4u);
  for (const std::size_t refused : {0u, 3u}) {
    EXPECT_EQ(replies[refused].accepted, 0);
    EXPECT_NE(replies[refused].text.find("no coulomb_friction with these values was added"),
              std::string::npos)
        << replies[refused].text;
  }
  EXPECT_EQ(replies[2].applied_seq, 250);
}

// If one process of the ring is silent, all others wait. Its neighbour reports first.
TEST(Patience, OfAProcessFurtherFromTheSilentOneIsLonger) {
  const auto make = [](Patience patience) {
    auto process =
        std::make_unique<Process>(ProcessInfo{Role::kEstimator, "test", ""},
                                  ProcessOptions{.config = "dilys2021",
                                                 .url = "memq://",
                                                 .overrides = {"bus.peer_timeout_s=0.05"},
                                                 .session = kSession});
    process->waiting_for([patience] { return Waiting{"a message", patience}; });
    process->ready();
    process->progress(0);
    return process;
  };
  const auto near = make(Patience::kForGain);        // 0.05 s
  const auto far = make(static_cast<Patience>(50));  // ten seconds more
  const auto begun = std::chrono::steady_clock::now();
  const auto elapsed = [&] { return std::chrono::steady_clock::now() - begun; };
  while (elapsed() < std::chrono::milliseconds(250) ||
         (!near->stopping() && elapsed() < std::chrono::seconds(8))) {
    near->turn(5);
    far->turn(5);  // looks at its patience every tenth of a second
  }
  EXPECT_TRUE(near->stopping());
  EXPECT_EQ(near->exit_code(), 1);
  EXPECT_FALSE(far->stopping());
}

}  // namespace
}  // namespace twinrate::bus_test

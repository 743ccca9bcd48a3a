// The account of a log, counted by hand: what was received, what was lost, what came twice. And the
// files themselves: whole events, a manifest at the head of each.
#include "logger/tick_log.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <optional>

#include "core/run_log.hpp"
#include "core/signals_io.hpp"

namespace twinrate::tick_log_test {
namespace {

namespace fs = std::filesystem;

constexpr int kGainEvery = 5;

class LogFiles : public testing::Test {
 public:
  ~LogFiles() override { fs::remove_all(directory_); }

 protected:
  LogFiles()
      : directory_(fs::temp_directory_path() / ("twinrate-logger-" + std::to_string(getpid()))) {
    fs::remove_all(directory_);
    fs::create_directories(directory_);
    drive_.rates.n = kGainEvery;
  }

  struct Event {
    std::string channel;
    std::int64_t t_us;
    std::string bytes;
  };
  std::vector<Event> events(const std::string& name = "log.lcm") const {
    std::vector<Event> list;
    lcm::LogFile file(path(name), "r");
    while (const lcm::LogEvent* event = file.readNextEvent())
      list.push_back(
          {event->channel,
           event->timestamp,
           {static_cast<const char*>(event->data), static_cast<std::size_t>(event->datalen)}});
    return list;
  }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  fs::path directory_;
  DriveConfig drive_;
};

// A log that takes messages of eight bytes.
class Account : public LogFiles {
 protected:
  TickLog& log(TickLog::Order order) { return log_.emplace(writer_, order, drive_, "", 0); }
  void take(Channel channel, std::int64_t k) { take_at(channel, k, 200'000 * k); }
  void take_at(Channel channel, std::int64_t k, std::int64_t t_ns) {
    constexpr std::uint8_t kBytes[8] = {};
    log_->take(channel, k, t_ns, kBytes, sizeof kBytes);
  }
  void take_tick(std::int64_t k) {
    for (const Channel channel : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                                  Channel::kReference, Channel::kCommand})
      take(channel, k);
    if (k % kGainEvery == 0) take(Channel::kGain, k);
  }
  const ChannelAccount& of(Channel channel) const { return log_->account(channel); }

  LogWriter writer_{directory_.string(), 100'000'000};
  std::optional<TickLog> log_;
};

TEST_F(Account, ARealtimeRunWithoutGapsHasLostNothing) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 40; ++k) take_tick(k);
  log_->close();
  for (const ChannelInfo& channel : kChannels) {
    EXPECT_EQ(of(channel.channel).lost, 0) << channel.name;
    EXPECT_EQ(of(channel.channel).duplicates, 0) << channel.name;
  }
  EXPECT_EQ(of(Channel::kMeasurement).received, 40);
  EXPECT_EQ(of(Channel::kGain).received, 8);
}

// A logger that is started again goes on with the number of the next part.
TEST_F(LogFiles, ThePartsOfAResumedLogGoOnCounting) {
  LogWriter first(directory_.string(), 100'000'000);
  LogWriter resumed(directory_.string(), 100'000'000, 2);
  EXPECT_EQ(first.files(), std::vector<std::string>{path("log.lcm")});
  EXPECT_EQ(resumed.files(), std::vector<std::string>{path("log-002.lcm")});
}

// The line of a full disk says how far the log reaches.
TEST_F(Account, ARealtimeRunKnowsTheLastTickOnTheDisk) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 7; ++k) take_tick(k);
  EXPECT_EQ(writer_.marked_on_disk(), 0);
  ASSERT_TRUE(writer_.flush());
  EXPECT_EQ(writer_.marked_on_disk(), 6);
}

TEST_F(Account, ARealtimeRunCountsTheMessagesOfAGapAndTheGainsAmongThem) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 40; ++k)
    if (k < 13 || k >= 27) take_tick(k);  // without the gains of 15, 20 and 25
  log_->close();
  EXPECT_EQ(of(Channel::kMeasurement).lost, 14);
  EXPECT_EQ(of(Channel::kCommand).lost, 14);
  EXPECT_EQ(of(Channel::kGain).lost, 3);
}

TEST_F(Account, AMessageThatComesAgainIsADuplicateAndNoGap) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 10; ++k) {
    take_tick(k);
    if (k == 6) take(Channel::kMeasurement, 4);
  }
  EXPECT_EQ(of(Channel::kMeasurement).duplicates, 1);
  EXPECT_EQ(of(Channel::kMeasurement).lost, 0);
  EXPECT_EQ(of(Channel::kMeasurement).received, 10);
}

// A command of an earlier tick that comes late does not shorten the gap behind it.
TEST_F(Account, ALateMessageLeavesTheLostOnesCounted) {
  log(TickLog::Order::kByTick);
  for (std::int64_t k = 0; k < 6; ++k) take(Channel::kMeasurement, k);
  for (const std::int64_t k : {0, 5, 1}) take(Channel::kCommand, k);
  log_->close();
  EXPECT_EQ(of(Channel::kCommand).lost, 3);
}

TEST_F(Account, ATickIsWholeWithAGainAtSnapshotsOnly) {
  log(TickLog::Order::kByTick);
  for (std::int64_t k = 0; k < 8; ++k) {
    take_tick(k);
    EXPECT_EQ(log_->complete_below(), k + 1);
  }
  for (std::int64_t k = 8; k < 12; ++k)
    for (const Channel channel : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                                  Channel::kReference, Channel::kCommand})
      take(channel, k);
  EXPECT_EQ(log_->complete_below(), 10) << "tick 10 lacks its gain";
  const auto missing = log_->missing(10);
  ASSERT_EQ(missing.size(), 1u);
  EXPECT_EQ(missing[0].channel, Channel::kGain);
  EXPECT_EQ(missing[0].seq, 10);
  take(Channel::kGain, 10);
  EXPECT_EQ(log_->complete_below(), 12);
}

class LocksFirst : public Account {
 protected:
  // A tick whose estimate has this status.
  void take_tick(std::int64_t k, int status, bool gain) {
    Estimate e;
    e.k = k;
    e.status = status;
    const estimate_t wire = to_wire(e, 1);
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
    wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    take(Channel::kMeasurement, k);
    take(Channel::kTruth, k);
    log_->take(Channel::kEstimate, k, 200'000 * k, bytes.data(), bytes.size());
    if (gain) take(Channel::kGain, k);
    take(Channel::kReference, k);
    take(Channel::kCommand, k);
  }
};

TEST_F(LocksFirst, ATickIsWholeWithAGainWhereItsEstimateAsksForOne) {
  log(TickLog::Order::kByTick);
  for (std::int64_t k = 0; k < 10; ++k) take_tick(k, kGainEveryTick, k != 7);
  EXPECT_EQ(log_->complete_below(), 7);
  const auto missing = log_->missing(10);
  ASSERT_EQ(missing.size(), 1u);
  EXPECT_EQ(missing[0].channel, Channel::kGain);
  EXPECT_EQ(missing[0].seq, 7);
  take(Channel::kGain, 7);
  for (std::int64_t k = 10; k < 30; ++k) take_tick(k, 0, k % kGainEvery == 0);
  EXPECT_EQ(log_->complete_below(), 30);
  EXPECT_EQ(of(Channel::kGain).received, 14);
}

TEST_F(LocksFirst, ARealtimeRunCountsTheGainsThatEachTickOwes) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 10; ++k)
    if (k != 4) take_tick(k, kGainEveryTick, k != 5 && k != 6);
  for (std::int64_t k = 10; k < 30; ++k) take_tick(k, 0, k % kGainEvery == 0 && k != 20);
  log_->close();
  EXPECT_EQ(of(Channel::kGain).lost, 4);
  EXPECT_EQ(log_->gain_rate().from, 10);
}

// The period of n ticks counts from tick 0, also where the filter locks between two snapshots.
TEST_F(LocksFirst, SnapshotsStayMultiplesOfN) {
  log(TickLog::Order::kAsItComes);
  for (std::int64_t k = 0; k < 13; ++k) take_tick(k, kGainEveryTick, true);
  for (std::int64_t k = 13; k < 30; ++k) take_tick(k, 0, k % kGainEvery == 0);
  log_->close();
  EXPECT_EQ(of(Channel::kGain).lost, 0);
  EXPECT_EQ(log_->gain_rate().from, 10);
}

TEST_F(Account, WhatCameBeforeTheMeasurementOfItsTickIsAskedForAgain) {
  log(TickLog::Order::kByTick);
  take(Channel::kCommand, 0);
  take_at(Channel::kMeasurement, 1, 0);
  for (const Channel channel : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                                Channel::kGain, Channel::kReference})
    take(channel, 0);
  EXPECT_EQ(log_->complete_below(), 0);
  const auto missing = log_->missing(1);
  ASSERT_EQ(missing.size(), 1u);
  EXPECT_EQ(missing[0].channel, Channel::kCommand);
  EXPECT_EQ(missing[0].seq, 0);
  take(Channel::kCommand, 0);
  EXPECT_EQ(log_->complete_below(), 1);
  for (const Channel channel :
       {Channel::kTruth, Channel::kEstimate, Channel::kReference, Channel::kCommand})
    take(channel, 1);
  EXPECT_EQ(log_->complete_below(), 1) << "MEASUREMENT(1) came before COMMAND(0)";
  ASSERT_EQ(log_->missing(10).size(), 1u);
  EXPECT_EQ(log_->missing(10)[0].channel, Channel::kMeasurement);
  take(Channel::kMeasurement, 1);
  EXPECT_EQ(log_->complete_below(), 2);
}

TEST_F(Account, ATickTooFarAheadIsRefused) {
  log(TickLog::Order::kByTick).admit_ahead(3);
  constexpr std::uint8_t kBytes[8] = {};
  EXPECT_TRUE(log_->take(Channel::kTruth, 2, 0, kBytes, sizeof kBytes));
  EXPECT_FALSE(log_->take(Channel::kTruth, 3, 0, kBytes, sizeof kBytes));
  EXPECT_LE(log_->missing(100).size(), 18u);
}

TEST_F(Account, AStoppedRunHasLostGapsButNotWhatItHadNotSaidYet) {
  log(TickLog::Order::kByTick);
  for (std::int64_t k = 0; k < 4; ++k) take_tick(k);
  take(Channel::kMeasurement, 4);  // the run stops within this tick
  log_->close();
  for (const Channel channel : {Channel::kMeasurement, Channel::kEstimate, Channel::kCommand})
    EXPECT_EQ(of(channel).lost, 0);

  log(TickLog::Order::kByTick);
  for (std::int64_t k = 0; k < 9; ++k)
    if (k != 3 && k != 5) take_tick(k);
  log_->close();
  EXPECT_EQ(of(Channel::kEstimate).lost, 2);
  EXPECT_EQ(of(Channel::kGain).lost, 0) << "the gain of tick 5 has no later one behind it";
}

TEST_F(Account, TimeStampsNeverRunBack) {
  log(TickLog::Order::kAsItComes);
  take(Channel::kMeasurement, 10);
  take(Channel::kEstimate, 9);  // of the tick before
  take(Channel::kEvent, 3);
  take(Channel::kMeasurement, 11);
  writer_.flush();
  const std::vector<Event> list = events();
  ASSERT_EQ(list.size(), 4u);
  EXPECT_EQ(list[0].t_us, 2000);
  EXPECT_EQ(list[1].t_us, 2000);
  EXPECT_EQ(list[2].t_us, 2000);
  EXPECT_EQ(list[3].t_us, 2200);
}

TEST_F(LogFiles, EveryRotatedPartBeginsWithTheManifestAndItsMarksSayWhetherItGoesOn) {
  const std::vector<std::uint8_t> bytes(100);
  {
    LogWriter writer(directory_.string(), 1050);
    writer.set_manifest("DRIVE_MANIFEST", bytes, 0);
    for (int k = 0; k < 20; ++k) writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), k);
    EXPECT_EQ(writer.files().size(), 3u);
  }
  int commands = 0;
  for (const char* part : {"log.lcm", "log-001.lcm", "log-002.lcm"}) {
    const std::vector<Event> list = events(part);
    ASSERT_GT(list.size(), 1u) << part;
    for (std::size_t i = 0; i < list.size(); ++i) {
      const bool mark = i == 1 || i + 1 == list.size();
      EXPECT_EQ(list[i].channel, i == 0 ? "DRIVE_MANIFEST"
                                 : mark ? "TWINRATE_LOG"
                                        : "DRIVE_COMMAND")
          << part << " " << i;
    }
    EXPECT_EQ(list[1].bytes, "begins") << part;
    EXPECT_EQ(list.back().bytes, part == std::string("log-002.lcm") ? "ends" : "continues");
    commands += static_cast<int>(list.size()) - 3;
  }
  EXPECT_EQ(commands, 20);
}

// A file that may not grow beyond a limit is a full disk.
class SmallDisk {
 public:
  explicit SmallDisk(rlim_t bytes) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{.rlim_cur = bytes, .rlim_max = before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~SmallDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_before_);
  }

 private:
  rlimit before_{};
  sighandler_t signal_before_ = std::signal(SIGXFSZ, SIG_IGN);
};

TEST_F(LogFiles, WhereTheDiskIsFullTheLogEndsWithAWholeEvent) {
  const std::vector<std::uint8_t> bytes(1000);
  std::int64_t written = 0;
  {
    LogWriter writer(directory_.string(), 100'000'000);
    const SmallDisk disk(150'000);
    while (written < 1000 && writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), written))
      ++written;
    EXPECT_TRUE(writer.full());
  }
  const std::size_t one = 28 + std::string("DRIVE_COMMAND").size() + bytes.size();
  const std::size_t size = fs::file_size(path("log.lcm"));
  EXPECT_EQ(size % one, 0u);
  EXPECT_EQ(events().size(), size / one);
  EXPECT_GT(size, 50'000u);
  EXPECT_LE(size, 150'000u);
}

// What is said of the ticks on the disk is what a reader counts, whatever part of a tick was written.
TEST_F(LogFiles, WhereTheDiskIsFullTheLogEndsWithItsLastMark) {
  struct Case {
    std::int64_t rotate_bytes;
    std::size_t files;      // the disk gets full in the last one of so many
    rlim_t limit_bytes;     // of that file
    bool in_place = false;  // and a megabyte a write: only a part of it is on the disk
  };
  constexpr int kMessagesATick = 7;  // the second file begins within a tick
  const std::vector<std::uint8_t> manifest(50), bytes(1000);
  for (const Case c : {Case{100'000'000, 1, 150'000}, Case{70'500, 2, 3000}, Case{70'500, 2, 1500},
                       Case{70'500, 2, 10'500}, Case{100'000'000, 1, 150'000, true},
                       Case{70'500, 2, 3000, true}}) {
    fs::remove_all(directory_);
    std::int64_t said = 0;
    {
      LogWriter writer(directory_.string(), c.rotate_bytes, 0, c.in_place ? 1 << 20 : 65536);
      writer.set_manifest("DRIVE_MANIFEST", manifest, 0);
      std::optional<SmallDisk> disk;
      for (std::int64_t i = 0; i < 1200 && !writer.full(); ++i) {
        if (!c.in_place)
          writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), i);
        else if (std::uint8_t* const room = writer.room_for("DRIVE_COMMAND", bytes.size(), i))
          std::copy(bytes.begin(), bytes.end(), room);
        if (i % kMessagesATick == kMessagesATick - 1) writer.mark((i + 1) / kMessagesATick);
        if (writer.files().size() < c.files) continue;
        if (!disk) disk.emplace(c.limit_bytes);
        if (!c.in_place) writer.flush();
      }
      EXPECT_TRUE(writer.full());
      said = writer.marked_on_disk();
    }
    std::int64_t commands = 0;
    for (const auto& entry : fs::directory_iterator(directory_))
      for (const Event& event : events(entry.path().filename().string()))
        commands += event.channel == "DRIVE_COMMAND";
    EXPECT_GT(said, 5) << c.limit_bytes;
    EXPECT_EQ(commands, kMessagesATick * said) << c.limit_bytes;
  }
}

// A long manifest: the first tick is written in two pieces.
TEST_F(LogFiles, WhereTheDiskIsFullWithinTheFirstTickNothingOfItIsLeft) {
  const std::vector<std::uint8_t> manifest(64'000), bytes(1000);
  {
    LogWriter writer(directory_.string(), 100'000'000);
    const SmallDisk disk(70'000);
    writer.set_manifest("DRIVE_MANIFEST", manifest, 0);
    for (int i = 0; i < 5; ++i) writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), 0);
    EXPECT_TRUE(writer.flush() && fs::file_size(path("log.lcm")) > 68'000);
    for (int i = 0; i < 5; ++i) writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), 0);
    EXPECT_FALSE(writer.flush());
    EXPECT_EQ(writer.marked_on_disk(), 0);
  }
  for (const Event& event : events()) EXPECT_NE(event.channel, "DRIVE_COMMAND");
  EXPECT_EQ(events().size(), 2u) << "manifest and mark";
}

// Two ways to write the same: the caller's bytes in small writes to the disk, and bytes that are
// encoded in the writer's buffer, a megabyte a write.
TEST_F(LogFiles, WhatIsEncodedInTheBufferOfTheWriterIsTheSameLog) {
  const std::vector<std::uint8_t> manifest(50);
  const auto written = [&](bool in_place) {
    fs::remove_all(directory_);
    LogWriter writer(directory_.string(), 1'500'000, 0, in_place ? 1 << 20 : 65536);
    writer.set_manifest("DRIVE_MANIFEST", manifest, 0);
    for (int i = 0; i < 4000; ++i) {
      const std::vector<std::uint8_t> bytes(static_cast<std::size_t>(i % 1000),
                                            static_cast<std::uint8_t>(i));
      if (!in_place) {
        EXPECT_TRUE(writer.write("DRIVE_COMMAND", bytes.data(), bytes.size(), i));
        continue;
      }
      std::uint8_t* const room = writer.room_for("DRIVE_COMMAND", bytes.size(), i);
      if (!room) return std::string("no room");
      std::copy(bytes.begin(), bytes.end(), room);
    }
    EXPECT_TRUE(writer.finish());
    EXPECT_EQ(writer.files().size(), 2u);
    std::string all;
    for (const std::string& file : writer.files()) {
      std::ifstream in(file, std::ios::binary);
      all.append(std::istreambuf_iterator<char>(in), {});
    }
    return all;
  };
  const std::string log = written(false);
  EXPECT_GT(log.size(), 2'000'000u);
  EXPECT_TRUE(written(true) == log);
}

// A realtime log holds messages as they came; who reads it finds them by tick.
TEST_F(LogFiles, AReaderFindsMessagesThatCameOutOfOrderByTheirTick) {
  {
    LogWriter writer(directory_.string(), 100'000'000);
    const auto write = [&](const auto& wire) {
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
      wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      writer.write(info(kChannelOf<std::decay_t<decltype(wire)>>).name, bytes.data(), bytes.size(),
                   0);
    };
    for (std::int64_t k : {0, 2, 1, 3}) {
      write(to_wire(Measurement{.k = k}, 1));
      write(to_wire(Estimate{.k = k}, 1));
      write(to_wire(Gain{.k = 5 * k, .n_x = 4, .n_y = 2}, 1));
      write(to_wire(Command{.k = k}, 1));
    }
  }
  const RunLog log = read_run_log(directory_.string());
  for (std::size_t i = 0; i < 4; ++i) {
    const auto k = static_cast<std::int64_t>(i);
    EXPECT_EQ(log.measurement.at(i).k, k);
    EXPECT_EQ(log.estimate.at(i).k, k);
    EXPECT_EQ(log.gain.at(i).k, 5 * k);
    EXPECT_EQ(log.command.at(i).k, k);
  }
}

}  // namespace
}  // namespace twinrate::tick_log_test

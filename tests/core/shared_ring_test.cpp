// The shared-memory ring: order, wrap-round, readers that are lapped, writers that are killed, damaged
// memory, waking.
#include "core/shared_ring.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <optional>
#include <random>
#include <thread>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/seconds_since.hpp"
#include "model/signals.hpp"

namespace twinrate::shared_ring_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Every byte follows from the number, so that a mixture of two messages shows.
Bytes message(std::uint64_t number, std::size_t size = 200) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(number * 31 + i * 7);
  std::memcpy(bytes.data(), &number, std::min(size, sizeof number));
  return bytes;
}
std::uint64_t number_of(const RingMember::Message& m) {
  std::uint64_t number = 0;
  std::memcpy(&number, m.bytes, sizeof number);
  return number;
}
Bytes bytes_of(const RingMember::Message& m) {
  return {m.bytes, m.bytes + m.size};
}

class SharedRing : public ::testing::Test {
 protected:
  void publish(RingMember& writer, Channel channel, const Bytes& bytes) {
    writer.put(channel, bytes.data(), bytes.size());
    writer.publish();
  }
  RingMember member(Role role) { return RingMember(memory_.path(), role); }
  std::optional<std::uint64_t> next(RingMember& reader) {
    RingMember::Message m{};
    if (!reader.next(m)) return {};
    return number_of(m);
  }
  // The memory as somebody has it who can open it.
  struct Mapped {
    explicit Mapped(const std::string& path) : file(open(path.c_str(), O_RDWR)) {
      size = static_cast<std::size_t>(lseek(file.get(), 0, SEEK_END));
      words = static_cast<std::uint64_t*>(
          mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file.get(), 0));
    }
    ~Mapped() { munmap(words, size); }
    // The head of the message with these bytes: size and channel.
    std::uint64_t& head_of(const Bytes& bytes) const {
      const auto* begin = reinterpret_cast<const std::uint8_t*>(words);
      const auto* found = std::search(begin, begin + size, bytes.begin(), bytes.end());
      return words[(found - begin) / 8 - 2];
    }
    FileDescriptor file;
    std::size_t size = 0;
    std::uint64_t* words = nullptr;
  };

  SharedMemory memory_;
};

TEST_F(SharedRing, GivesTheMessagesOfSeveralWritersInTheOrderOfTheirCauses) {
  RingMember plant = member(Role::kPlant), estimator = member(Role::kEstimator),
             controller = member(Role::kController), logger = member(Role::kLogger);
  for (const Channel c : {Channel::kMeasurement, Channel::kTruth, Channel::kEstimate,
                          Channel::kReference, Channel::kCommand})
    logger.want(c, true);
  for (std::uint64_t k = 0; k < 50; k += 5) {
    plant.put(Channel::kMeasurement, message(k).data(), 200);
    publish(plant, Channel::kTruth, message(k + 1));
    publish(estimator, Channel::kEstimate, message(k + 2));
    controller.put(Channel::kReference, message(k + 3).data(), 200);
    publish(controller, Channel::kCommand, message(k + 4));
  }
  for (std::uint64_t k = 0; k < 50; ++k) EXPECT_EQ(next(logger), k);
  EXPECT_FALSE(next(logger));
}

TEST_F(SharedRing, GivesOnlyChannelsThatAreWanted) {
  RingMember plant = member(Role::kPlant), estimator = member(Role::kEstimator);
  estimator.want(Channel::kMeasurement, true);
  publish(plant, Channel::kTruth, message(1));
  publish(plant, Channel::kMeasurement, message(2));
  EXPECT_EQ(next(estimator), 2U);
  EXPECT_FALSE(next(estimator));
}

TEST_F(SharedRing, KeepsEveryByteOfMessagesOfAllSizesRoundItsEnd) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  std::size_t total = 0;
  for (std::uint64_t k = 0; total < (8U << 20); ++k) {
    const std::size_t size = k % 100 == 0 ? RingMember::kMaxBytes : 8 + k % 1000;
    total += size;
    publish(plant, Channel::kMeasurement, message(k, size));
    RingMember::Message m{};
    ASSERT_TRUE(logger.next(m)) << k;
    ASSERT_EQ(bytes_of(m), message(k, size)) << k;
  }
  EXPECT_EQ(logger.malformed(), 0);
}

TEST_F(SharedRing, LeavesOldMessagesOutForAReaderThatWasLapped) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  publish(plant, Channel::kMeasurement, message(0));
  publish(plant, Channel::kMeasurement, message(1));
  EXPECT_EQ(next(logger), 0U);
  for (std::uint64_t k = 2; k < 10'000; ++k) publish(plant, Channel::kMeasurement, message(k));
  EXPECT_FALSE(next(logger)) << "message 1 was overwritten";
  publish(plant, Channel::kMeasurement, message(10'000));
  EXPECT_EQ(next(logger), 10'000U);
  EXPECT_EQ(logger.malformed(), 0);
}

// From each look of the reader the writer goes on by at most `ahead` messages, while the reader copies: less than a
// ring in half of the looks, more in the others. So at any speed of the machine it hears messages and is lapped.
TEST_F(SharedRing, NeverMixesTwoMessagesForAReaderThatIsBeingLapped) {
  constexpr std::uint64_t kRing = 26;   // messages of this size in a ring
  constexpr std::int64_t kEnough = 50;  // heard, and left out
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  std::atomic<std::uint64_t> written = 0, allowed = 0;
  std::atomic<bool> stop = false;
  std::thread writer([&] {
    for (std::uint64_t k = 0; !stop; ++k) {
      while (k >= allowed && !stop) std::this_thread::yield();
      publish(plant, Channel::kMeasurement, message(k, 20'000));
      written = k + 1;
    }
  });
  std::int64_t heard = 0, left_out = 0;
  std::optional<std::uint64_t> before;
  for (std::uint64_t look = 0; heard < kEnough || left_out < kEnough; ++look) {
    const std::uint64_t ahead = look / 4 * 7 % (2 * kRing);
    allowed = std::max<std::uint64_t>(allowed, written + ahead);
    while (look % 4 == 3 && written < allowed) std::this_thread::yield();
    RingMember::Message m{};
    if (!logger.next(m)) continue;
    const std::uint64_t number = number_of(m);
    if (bytes_of(m) != message(number, 20'000)) {
      ADD_FAILURE() << "mixed: " << number;
      break;
    }
    EXPECT_TRUE(!before || number > *before);
    left_out += before ? static_cast<std::int64_t>(number - *before) - 1 : 0;
    before = number;
    ++heard;
  }
  stop = true;
  writer.join();
  EXPECT_EQ(logger.malformed(), 0);
}

// The kernel kills a process at any instruction: this one between its words and the head.
TEST_F(SharedRing, OfAWriterThatIsKilledWhileItWritesIsHeardFromItsSuccessor) {
  RingMember logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  const pid_t child = fork();
  if (child == 0) {
    RingMember plant = member(Role::kPlant);
    publish(plant, Channel::kMeasurement, message(1));
    for (std::uint64_t k = 2; k < 100; ++k)
      plant.put(Channel::kMeasurement, message(k).data(), 200);
    raise(SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(next(logger), 1U);
  EXPECT_FALSE(next(logger));
  RingMember successor = member(Role::kPlant);
  publish(successor, Channel::kMeasurement, message(200));
  EXPECT_EQ(next(logger), 200U);
  EXPECT_EQ(logger.malformed(), 0);
}

TEST_F(SharedRing, ARestartedReaderHearsWhatComesFromThenOn) {
  RingMember plant = member(Role::kPlant);
  publish(plant, Channel::kMeasurement, message(1));
  RingMember gain = member(Role::kGain);
  gain.want(Channel::kMeasurement, true);
  publish(plant, Channel::kMeasurement, message(2));
  EXPECT_EQ(next(gain), 2U);
}

TEST_F(SharedRing, HasOnePlaceForEachRole) {
  {
    RingMember plant = member(Role::kPlant);
    EXPECT_THROW(member(Role::kPlant), BadInput);
  }
  EXPECT_NO_THROW(member(Role::kPlant));
}

TEST_F(SharedRing, RefusesWhatIsNoMemoryOfASet) {
  for (const char* path : {"", "/dev/null", "/proc/self/exe", "/nowhere"})
    EXPECT_THROW(RingMember(path, Role::kPlant), BadInput) << path;
  Mapped mapped(memory_.path());
  *mapped.words = 1;
  EXPECT_THROW(member(Role::kPlant), BadInput) << "without its mark";
}

TEST_F(SharedRing, HasASizeThatNobodyCanChange) {
  const FileDescriptor file(open(memory_.path().c_str(), O_RDWR));
  ASSERT_GE(file.get(), 0);
  EXPECT_NE(ftruncate(file.get(), 4096), 0);
  EXPECT_NE(ftruncate(file.get(), 1 << 30), 0);
}

TEST_F(SharedRing, CountsAMessageWithAWrongHeadAndHearsTheNextOnes) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  logger.want(Channel::kCommand, true);
  Mapped mapped(memory_.path());
  const auto head = [](std::uint64_t size, std::uint64_t channel) { return size | channel << 32; };
  std::uint64_t number = 1;
  std::int64_t wrong = 0;
  for (const std::uint64_t damaged :
       {head(0xffffffff, 0), head(RingMember::kMaxBytes + 1, 0), head(60'000, 0), head(201, 0),
        head(200, 12), head(200, 0xffffffff), head(200, static_cast<int>(Channel::kCommand))}) {
    publish(plant, Channel::kMeasurement, message(number));
    mapped.head_of(message(number)) = damaged;
    EXPECT_FALSE(next(logger)) << damaged;
    EXPECT_EQ(logger.malformed(), ++wrong) << damaged;
    publish(plant, Channel::kMeasurement, message(++number));
    EXPECT_EQ(next(logger), number);
    ++number;
  }
}

TEST_F(SharedRing, CountsAMessageThatIsLargerThanAnyThoughTheRingHoldsAsMuch) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  for (std::uint64_t k = 0; k < 1000; ++k) publish(plant, Channel::kMeasurement, message(k));
  Mapped(memory_.path()).head_of(message(0)) = RingMember::kMaxBytes + 8;
  EXPECT_FALSE(next(logger));
  EXPECT_EQ(logger.malformed(), 1);
}

TEST_F(SharedRing, ThatGoesBackHoldsNoReader) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  logger.want(Channel::kMeasurement, true);
  // As many as fill the ring: a reader that went on from its end would go round for ever.
  constexpr std::uint64_t kMessages = 2048, kWordsOfOne = 32;
  for (std::uint64_t k = 0; k < kMessages; ++k) publish(plant, Channel::kTruth, message(k, 240));
  EXPECT_FALSE(next(logger));
  Mapped mapped(memory_.path());
  std::uint64_t* reserved = mapped.words;  // with the same number after it: the head
  while (reserved[0] != kMessages * kWordsOfOne || reserved[1] != reserved[0]) ++reserved;
  reserved[1] -= kWordsOfOne;
  EXPECT_FALSE(next(logger));
}

TEST_F(SharedRing, OfRandomWordsNeitherStopsNorHoldsAReader) {
  RingMember plant = member(Role::kPlant), logger = member(Role::kLogger);
  for (const Channel c : {Channel::kMeasurement, Channel::kEstimate, Channel::kCommand})
    logger.want(c, true);
  Mapped mapped(memory_.path());
  const std::size_t count = mapped.size / 8;
  std::mt19937_64 random(7);
  for (int round = 0; round < 200; ++round) {
    for (std::size_t i = 1; i < count; i += 1 + random() % 32)
      mapped.words[i] = random() % 3 == 0 ? random() : random() % 70'000;
    RingMember::Message m{};
    for (int i = 0; i < 1000 && logger.next(m); ++i) ASSERT_LE(m.size, RingMember::kMaxBytes);
    logger.sleep(0, true);
    publish(plant, Channel::kMeasurement, message(1));
  }
}

TEST_F(SharedRing, ThinsEstimatesForAReaderThatCannotUseAll) {
  RingMember estimator = member(Role::kEstimator), gain = member(Role::kGain);
  gain.want(Channel::kEstimate, true);
  gain.thin_estimates({.every = 5, .from = 2});
  const auto estimate = [](std::uint64_t seq, bool asks_for_gain) {
    Bytes bytes(kEstimateStatusAt + 8);
    for (int i = 0; i < 8; ++i) bytes[8 + i] = static_cast<std::uint8_t>(seq >> (56 - 8 * i));
    if (asks_for_gain)
      for (int i = 0; i < 4; ++i)
        bytes[kEstimateStatusAt + i] = static_cast<std::uint8_t>(kGainEveryTick >> (24 - 8 * i));
    return bytes;
  };
  for (std::uint64_t k = 0; k < 12; ++k)
    publish(estimator, Channel::kEstimate, estimate(k, k == 7));
  std::vector<int> heard;
  for (RingMember::Message m{}; gain.next(m);) heard.push_back(m.bytes[15]);
  EXPECT_EQ(heard, (std::vector<int>{0, 1, 5, 7, 10}));
}

double slept_s(RingMember& reader, double timeout_ms, bool for_all = false) {
  const auto begun = std::chrono::steady_clock::now();
  reader.sleep(timeout_ms, for_all);
  return seconds_since(begun);
}

TEST_F(SharedRing, AQuietChannelDoesNotEndASleepAndAWakingOneDoes) {
  RingMember plant = member(Role::kPlant), estimator = member(Role::kEstimator),
             controller = member(Role::kController);
  controller.want(Channel::kMeasurement, false);
  controller.want(Channel::kEstimate, true);
  publish(plant, Channel::kMeasurement, message(1));
  EXPECT_GE(slept_s(controller, 30), 0.029);
  EXPECT_LT(slept_s(controller, 10'000, true), 5);
  publish(estimator, Channel::kEstimate, message(2));
  EXPECT_LT(slept_s(controller, 10'000), 5);
}

TEST_F(SharedRing, AMessageWakesAReaderThatSleeps) {
  RingMember plant = member(Role::kPlant), estimator = member(Role::kEstimator);
  estimator.want(Channel::kMeasurement, true);
  std::thread writer([&] {
    for (std::uint64_t k = 0; k < 200; ++k) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));
      publish(plant, Channel::kMeasurement, message(k));
    }
  });
  const auto begun = std::chrono::steady_clock::now();
  for (std::uint64_t k = 0; k < 200;) {
    if (next(estimator)) {
      ++k;
      continue;
    }
    ASSERT_LT(slept_s(estimator, 10'000), 5) << k;
  }
  writer.join();
  EXPECT_LT(seconds_since(begun), 5);
}

TEST_F(SharedRing, AnotherThreadWakesAReaderThatSleeps) {
  RingMember estimator = member(Role::kEstimator);
  std::atomic<bool> awake = false;
  std::thread other([&] {
    while (!awake) {
      estimator.wake();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  EXPECT_LT(slept_s(estimator, 10'000), 5);
  awake = true;
  other.join();
}

}  // namespace
}  // namespace twinrate::shared_ring_test

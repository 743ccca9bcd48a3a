#include "core/shared_ring.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cerrno>
#include <climits>
#include <cstring>
#include <stdexcept>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/machine_error.hpp"
#include "model/signals.hpp"

namespace twinrate {
namespace {

constexpr std::uint64_t kMagic = 0x7477696e72617431;  // "twinrat1"
// Of a ring. MEASUREMENT and TRUTH of a tick take 35: kMostTicksInMemory.
constexpr std::size_t kWords = 1 << 16;
constexpr std::size_t kHeaderWords = 2;  // size and channel, stamp
constexpr std::size_t kMembersOfSet = 5;
constexpr std::size_t kLine = 64;  // a cache line

constexpr std::uint32_t bit(Channel channel) {
  return 1U << static_cast<int>(channel);
}

// Of each member: the channels that it may write.
constexpr std::array<std::uint32_t, kMembersOfSet> kChannelsOf = {
    bit(Channel::kMeasurement) | bit(Channel::kTruth), bit(Channel::kEstimate), bit(Channel::kGain),
    bit(Channel::kReference) | bit(Channel::kCommand), 0};

std::size_t index_of(Role role) {
  assert(role >= Role::kPlant && role <= Role::kLogger);
  return static_cast<std::size_t>(role) - static_cast<std::size_t>(Role::kPlant);
}

std::uint64_t words_of(std::size_t bytes) {
  return kHeaderWords + (bytes + 7) / 8;
}

std::uint64_t big_endian(const std::uint8_t* bytes, int count) {
  std::uint64_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | bytes[i];
  return value;
}

struct EstimateHead {
  std::uint64_t seq = 0;
  bool asks_for_gain = true;  // of a message that is too short to decide
};
EstimateHead head_of_estimate(const std::uint8_t* bytes, std::size_t size) {
  if (size < kEstimateStatusAt + 4) return {};
  return {big_endian(bytes + 8, 8),
          (big_endian(bytes + kEstimateStatusAt, 4) & kGainEveryTick) != 0};
}

long futex(std::atomic<std::uint32_t>& word, int operation, std::uint32_t value,
           const timespec* timeout) {
  return syscall(SYS_futex, &word, operation, value, timeout, nullptr, 0);
}

}  // namespace

struct SharedRings {
  struct alignas(kLine) Reader {
    std::atomic<std::uint32_t> asleep;  // the futex
    std::atomic<std::uint32_t> wakes;   // channels
    std::atomic<std::uint32_t> every;   // EstimateRate
    std::atomic<std::uint64_t> from;
    std::atomic<std::uint64_t> pid;  // 0: none yet
  };
  struct Ring {
    alignas(
        kLine) std::atomic<std::uint64_t> reserved;  // words; below it the writer has overwritten
    std::atomic<std::uint64_t> head;                 // words; below it messages are whole
    alignas(kLine) std::array<std::atomic<std::uint64_t>, kWords> words;
    std::atomic<std::uint64_t>& at(std::uint64_t position) { return words[position % kWords]; }
  };
  std::atomic<std::uint64_t> magic, supervisor_pid;  // 0: it hears the copies
  alignas(kLine) std::atomic<std::uint64_t> stamp;
  std::array<Reader, kMembersOfSet> readers;
  std::array<Ring, kMembersOfSet> rings;
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

SharedMemory::SharedMemory(bool hears_copies)
    : memory_(memfd_create("twinrate", MFD_CLOEXEC | MFD_ALLOW_SEALING)) {
  const std::array<std::uint64_t, 2> begin = {
      kMagic, hears_copies ? 0 : static_cast<std::uint64_t>(getpid())};
  // Nobody can shorten it: a reader would end with SIGBUS.
  const bool made =
      memory_.get() >= 0 && fchmod(memory_.get(), S_IRUSR | S_IWUSR) == 0 &&
      ftruncate(memory_.get(), sizeof(SharedRings)) == 0 &&
      pwrite(memory_.get(), begin.data(), sizeof begin, 0) == sizeof begin &&
      fcntl(memory_.get(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0;
  if (!made)
    throw MachineError(fmt::format("bus.shared_memory: the machine gives no shared memory: {}",
                                   std::strerror(errno)));
}

std::string SharedMemory::path() const {
  return fmt::format("/proc/{}/fd/{}", getpid(), memory_.get());
}

RingMember::RingMember(const std::string& path, Role role)
    : memory_(open(path.c_str(), O_RDWR | O_CLOEXEC)), own_(index_of(role)) {
  static_assert(kMembers == kMembersOfSet);
  struct stat file {};
  if (memory_.get() < 0 || fstat(memory_.get(), &file) != 0 || file.st_size != sizeof(SharedRings))
    throw BadInput(fmt::format("--shared-memory {}: no memory of a running set", path));
  // The kernel gives the lock back when the process ends, however it ends.
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_start = static_cast<off_t>(own_);
  lock.l_len = 1;
  if (fcntl(memory_.get(), F_OFD_SETLK, &lock) != 0)
    throw BadInput(fmt::format("--shared-memory {}: a {} of this set runs already", path,
                               role_name(static_cast<int>(role))));
  void* memory =
      mmap(nullptr, sizeof(SharedRings), PROT_READ | PROT_WRITE, MAP_SHARED, memory_.get(), 0);
  if (memory == MAP_FAILED)
    throw MachineError(fmt::format("--shared-memory {}: {}", path, std::strerror(errno)));
  rings_ = static_cast<SharedRings*>(memory);
  if (rings_->magic != kMagic) {
    munmap(memory, sizeof(SharedRings));
    throw BadInput(fmt::format("--shared-memory {}: no memory of a running set", path));
  }
  written_ = rings_->rings[own_].head;
  reserved_ = rings_->rings[own_].reserved;
  rings_->readers[own_].asleep = rings_->readers[own_].wakes = 0;
  rings_->readers[own_].pid = static_cast<std::uint64_t>(getpid());
  thin_estimates({});
  for (std::size_t i = 0; i < kMembers; ++i) {
    cursors_[i].channels = kChannelsOf[i];
    cursors_[i].position = cursors_[i].limit = rings_->rings[i].head;
    cursors_[i].bytes.resize(kMaxBytes);
  }
}

RingMember::~RingMember() {
  munmap(rings_, sizeof(SharedRings));
}

void RingMember::put(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  assert((kChannelsOf[own_] & bit(channel)) != 0);
  if (size > kMaxBytes)
    throw std::runtime_error(fmt::format("bus.shared_memory: {} has {} bytes, up to {} fit",
                                         info(channel).name, size, kMaxBytes));
  auto& ring = rings_->rings[own_];
  const std::uint64_t end = written_ + words_of(size);
  reserved_ = std::max(reserved_, end);  // a killed member may have announced more
  ring.reserved.store(reserved_, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  const auto write = [&](std::uint64_t word) {
    ring.at(written_++).store(word, std::memory_order_relaxed);
  };
  write(size | static_cast<std::uint64_t>(channel) << 32);
  write(rings_->stamp.fetch_add(1, std::memory_order_relaxed));
  for (std::size_t i = 0; i < size; i += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes + i, std::min<std::size_t>(8, size - i));
    write(word);
  }
  staged_ |= bit(channel);
  if (channel != Channel::kEstimate) return;
  const EstimateHead estimate = head_of_estimate(bytes, size);
  staged_seq_ = estimate.seq;
  staged_asks_ = estimate.asks_for_gain;
}

void RingMember::publish() {
  rings_->rings[own_].head.store(written_, std::memory_order_release);
  // Either the reader sees the head before it sleeps, or this process sees that it sleeps.
  std::atomic_thread_fence(std::memory_order_seq_cst);
  for (SharedRings::Reader& reader : rings_->readers) {
    std::uint32_t news = staged_ & reader.wakes.load(std::memory_order_relaxed);
    const EstimateRate rate{reader.every.load(std::memory_order_relaxed),
                            reader.from.load(std::memory_order_relaxed)};
    if (!rate.wants(staged_seq_, staged_asks_)) news &= ~bit(Channel::kEstimate);
    if (news != 0 && reader.asleep.load(std::memory_order_relaxed) != 0 &&
        reader.asleep.exchange(0) != 0)
      futex(reader.asleep, FUTEX_WAKE, INT_MAX, nullptr);
  }
  staged_ = 0;
}

void RingMember::want(Channel channel, bool wakes) {
  wanted_ |= bit(channel);
  if (wakes) waking_ |= bit(channel);
}

void RingMember::thin_estimates(EstimateRate rate) {
  rate_ = rate;
  rings_->readers[own_].every = rate.every;
  rings_->readers[own_].from = rate.from;
}

// The heads at one moment: they only rise, so two equal readings enclose it. A cause is published
// before its effect, so a message below the heads has its cause below them. False without new
// messages.
bool RingMember::collect() {
  constexpr int kTries = 100;
  std::array<std::uint64_t, kMembers> before{}, now{};
  const auto read = [this](std::array<std::uint64_t, kMembers>& heads) {
    for (std::size_t i = 0; i < kMembers; ++i)
      heads[i] = rings_->rings[i].head.load(std::memory_order_acquire);
  };
  read(before);
  for (int i = 0; i < kTries; ++i) {
    read(now);
    if (now == before) break;
    before = now;
  }
  bool any = false;
  for (std::size_t i = 0; i < kMembers; ++i) {
    Cursor& c = cursors_[i];
    any = any || now[i] != c.limit;
    c.limit = now[i];
    if ((c.channels & wanted_) == 0) c.position = c.limit;
  }
  return any;
}

// Also true for a position beyond the written part: the ring is damaged.
bool RingMember::was_lapped(std::size_t ring) const {
  std::atomic_thread_fence(std::memory_order_acquire);
  const std::uint64_t reserved = rings_->rings[ring].reserved.load(std::memory_order_relaxed);
  return reserved - cursors_[ring].position > kWords;
}

// Copies the message at the cursor if it is wanted. False if it is damaged or was overwritten.
bool RingMember::take(std::size_t ring, std::uint64_t& words) {
  Cursor& c = cursors_[ring];
  const auto word = [&](std::uint64_t i) {
    return rings_->rings[ring].at(c.position + i).load(std::memory_order_relaxed);
  };
  const std::uint64_t first = word(0), channel = first >> 32;
  c.size = first & UINT32_MAX;
  c.stamp = word(1);
  if (was_lapped(ring)) return false;
  words = words_of(c.size);
  if (c.size > kMaxBytes || words > c.limit - c.position || channel >= kChannelCount ||
      (c.channels & 1U << channel) == 0) {
    ++malformed_;
    return false;
  }
  c.channel = static_cast<Channel>(channel);
  if (!wants(c.channel)) return true;
  for (std::size_t i = 0; i < c.size; i += 8) {
    const std::uint64_t part = word(kHeaderWords + i / 8);
    std::memcpy(c.bytes.data() + i, &part, std::min<std::size_t>(8, c.size - i));
  }
  if (was_lapped(ring)) return false;
  if (c.channel == Channel::kEstimate) {
    const EstimateHead estimate = head_of_estimate(c.bytes.data(), c.size);
    c.loaded = rate_.wants(estimate.seq, estimate.asks_for_gain);
  } else {
    c.loaded = true;
  }
  return true;
}

void RingMember::load(std::size_t ring) {
  Cursor& c = cursors_[ring];
  while (!c.loaded && c.position != c.limit) {
    std::uint64_t words = 0;
    if (take(ring, words))
      c.position += words;
    else
      c.position = c.limit;
  }
}

bool RingMember::next(Message& message) {
  for (int round = 0; round < 2; ++round) {
    Cursor* first = nullptr;
    for (std::size_t i = 0; i < kMembers; ++i) {
      load(i);
      Cursor& c = cursors_[i];
      if (c.loaded && (!first || c.stamp < first->stamp)) first = &c;
    }
    if (first) {
      first->loaded = false;
      message = {first->channel, first->bytes.data(), first->size};
      return true;
    }
    if (round > 0 || !collect()) return false;
  }
  return false;
}

bool RingMember::has_news(std::uint32_t channels) const {
  for (std::size_t i = 0; i < kMembers; ++i)
    if ((cursors_[i].channels & channels) != 0 &&
        rings_->rings[i].head.load(std::memory_order_acquire) != cursors_[i].limit)
      return true;
  return false;
}

void RingMember::sleep(double timeout_ms, bool for_all) {
  SharedRings::Reader& reader = rings_->readers[own_];
  const std::uint32_t channels = for_all ? wanted_ : waking_;
  reader.wakes.store(channels, std::memory_order_relaxed);
  reader.asleep.store(1);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  if (!has_news(channels)) {
    const auto ns = static_cast<std::int64_t>(std::max(0.0, timeout_ms) * 1e6);
    const timespec timeout{.tv_sec = ns / 1'000'000'000, .tv_nsec = ns % 1'000'000'000};
    futex(reader.asleep, FUTEX_WAIT, 1, &timeout);
  }
  reader.asleep.store(0, std::memory_order_relaxed);
}

void RingMember::wake() {
  SharedRings::Reader& reader = rings_->readers[own_];
  if (reader.asleep.exchange(0) != 0) futex(reader.asleep, FUTEX_WAKE, INT_MAX, nullptr);
}

std::vector<pid_t> RingMember::processes() const {
  std::vector<pid_t> list;
  const auto add = [&list](std::uint64_t pid) {
    if (pid != 0 && pid <= INT_MAX) list.push_back(static_cast<pid_t>(pid));
  };
  add(rings_->supervisor_pid);
  for (const SharedRings::Reader& reader : rings_->readers) add(reader.pid);
  return list;
}

}  // namespace twinrate

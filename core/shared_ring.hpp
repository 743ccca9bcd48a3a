// Messages of a tick through memory shared by the processes of one host, instead of datagrams.
//
// Each process of the set writes a ring of its own and reads those of the others. No process can
// block another, even if it is killed while it writes. A message becomes visible as a whole
// (`head`). A writer does not wait for readers: it announces (`reserved`) the words that it is
// about to overwrite. A lapped reader skips the ring's old messages, which is a gap like any other.
// Messages of several rings come in the order of their causes: each has a stamp of one counter, and
// the heads are read as at one moment.
//
// The memory is of unknown origin to a reader: positions are masked, and a message is copied before
// it is checked. A message with a wrong length, or of a channel that is not its writer's, is
// counted as malformed, and the ring is skipped up to its head.
//
// A reader sleeps on a futex. Its writer wakes it for the channels that the reader has chosen.
#pragma once
#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/lcm_socket.hpp"

namespace twinrate {

struct SharedRings;  // the memory

// Half of the messages MEASUREMENT and TRUTH that a ring holds: a logger that waits for its disk is
// not lapped within a window (bus.window_ticks) of this many ticks.
inline constexpr int kMostTicksInMemory = 1024;

// The estimates that a gain process can use: those below tick `from`, then those of sequence
// numbers that are multiples of `every`, and any that asks for a gain (kGainEveryTick).
struct EstimateRate {
  std::uint32_t every = 1;
  std::uint64_t from = 0;
  bool wants(std::uint64_t seq, bool asks_for_gain) const {
    return every <= 1 || seq < from || seq % every == 0 || asks_for_gain;
  }
};

// The memory of a set, created by the process that starts the set. It has no name in a file system
// and ends with this object and the processes that use it. Throws MachineError.
class SharedMemory {
 public:
  // `hears_copies`: this process wants the messages of a tick that the logger sends over LCM.
  explicit SharedMemory(bool hears_copies = false);
  // The path that the processes of the set open, valid while this object exists.
  std::string path() const;

 private:
  FileDescriptor memory_;
};

// One process of a set: plant, estimator, gain, controller or logger.
class RingMember {
 public:
  static constexpr std::size_t kMaxBytes = 64 << 10;  // of a message

  // Throws BadInput: no memory of a set, or the role is taken.
  RingMember(const std::string& path, Role role);
  ~RingMember();
  RingMember(const RingMember&) = delete;
  RingMember& operator=(const RingMember&) = delete;

  // The messages put are visible to the others after publish().
  void put(Channel channel, const std::uint8_t* bytes, std::size_t size);
  void publish();

  // `wakes`: its messages end sleep().
  void want(Channel channel, bool wakes);
  void thin_estimates(EstimateRate rate);
  struct Message {
    Channel channel;
    const std::uint8_t* bytes;  // valid until the next call of next()
    std::size_t size;
  };
  // The next message of a wanted channel; false if there is none.
  bool next(Message& message);
  // Sleeps until a message comes or wake() is called; a signal ends it. `for_all`: also channels
  // that do not wake otherwise.
  void sleep(double timeout_ms, bool for_all);
  // From another thread of this process.
  void wake();
  std::int64_t malformed() const { return malformed_; }
  // The processes of the set that receive no copies of its messages.
  std::vector<pid_t> processes() const;

 private:
  static constexpr std::size_t kMembers = 5;
  struct Cursor {
    std::uint64_t position = 0, limit = 0;  // words; those below the limit may be read
    std::uint32_t channels = 0;             // those of the ring's writer
    bool loaded = false;
    std::uint64_t stamp = 0;
    Channel channel{};
    std::size_t size = 0;
    std::vector<std::uint8_t> bytes;
  };
  bool collect();
  void load(std::size_t ring);
  bool take(std::size_t ring, std::uint64_t& words);
  bool was_lapped(std::size_t ring) const;
  bool wants(Channel channel) const { return (wanted_ >> static_cast<int>(channel) & 1U) != 0; }
  bool has_news(std::uint32_t channels) const;

  FileDescriptor memory_;
  SharedRings* rings_ = nullptr;
  std::size_t own_;
  std::uint64_t written_ = 0, reserved_ = 0;  // words of the own ring
  std::uint32_t staged_ = 0;                  // channels
  std::uint64_t staged_seq_ = 0;              // of the staged estimate
  bool staged_asks_ = false;
  std::uint32_t wanted_ = 0, waking_ = 0;  // channels
  EstimateRate rate_;
  std::array<Cursor, kMembers> cursors_;
  std::int64_t malformed_ = 0;
};

}  // namespace twinrate

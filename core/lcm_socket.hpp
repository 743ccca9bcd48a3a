// LCM's UDP multicast (udpm), without liblcm's reader thread, pipe and queue.
//
// The datagrams are LCM's (core/lcm_datagram): stock tools receive the messages of LcmSender, and
// LcmReceiver receives theirs. A receiver reads several datagrams with one system call into buffers
// of a fixed size. Malformed datagrams are counted and dropped.
#pragma once
#include <netinet/in.h>
#include <sys/socket.h>
#include <time.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/lcm_datagram.hpp"

namespace twinrate {

struct UdpmAddress {
  std::uint32_t group = 0;  // network byte order
  std::uint16_t port = 0;   // host byte order
  int ttl = 0;
  int receive_buffer = 4 << 20;  // bytes; the kernel may grant less (net.core.rmem_max)
};

// A file descriptor that closes itself.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  ~FileDescriptor();
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

class LcmSender {
 public:
  // Throws MachineError if there is no route to the group.
  explicit LcmSender(const UdpmAddress& address);
  // As in LcmMessage::sender of the receivers.
  std::uint64_t name() const { return name_; }
  // A datagram that the kernel refuses is a lost one.
  void send(const std::string& channel, const std::uint8_t* bytes, std::size_t size);
  // Sends small messages with one system call, if there are at most kMostTogether.
  static constexpr std::size_t kMostTogether = 32;
  struct Small {
    const std::string* channel;
    const std::uint8_t* bytes;
    std::size_t size;
  };
  void send_together(const Small* messages, std::size_t count);

 private:
  void send_whole(const Small& message);
  struct Datagram {
    std::array<std::uint8_t, kWholeHeader> header;
    std::array<iovec, 3> parts;
  };
  FileDescriptor socket_;
  sockaddr_in to_;
  std::uint64_t name_;
  std::uint32_t sequence_ = 0;
  std::array<Datagram, kMostTogether> datagrams_;  // of send_together()
  std::array<mmsghdr, kMostTogether> list_{};
};

class LcmReceiver {
 public:
  // Joins the group. `batch`: datagrams of one system call. `stamped`: the kernel stamps the
  // arrival of each datagram. Throws MachineError.
  LcmReceiver(const UdpmAddress& address, std::size_t batch, bool stamped = false);
  LcmReceiver(const LcmReceiver&) = delete;
  LcmReceiver& operator=(const LcmReceiver&) = delete;

  int fd() const { return socket_.get(); }
  // Bytes of the receive buffer as the kernel counts them.
  int granted_buffer() const { return granted_buffer_; }
  // Datagrams that were read and not yet taken by next().
  bool has_read() const { return next_ < count_; }
  // The last read filled its batch: more may be there.
  bool was_full() const { return batch_ > 1 && count_ == batch_; }
  // Reads the waiting datagrams; false if there are none.
  bool read_now();
  // Waits for one datagram; `timeout_ms` is rounded to the kernel's clock tick.
  bool read_waiting(double timeout_ms);
  // The next whole message that was read; false if none is left. Valid until the next read.
  bool next(LcmMessage& message);
  std::int64_t malformed() const { return malformed_; }

 private:
  bool read(std::size_t most, int flags);
  bool read_one(int flags);
  std::int64_t arrival_us(std::size_t i) const;

  FileDescriptor socket_;
  int granted_buffer_ = 0;
  double timeout_ms_ = -1;
  std::size_t batch_, next_ = 0, count_ = 0;
  std::unique_ptr<std::uint8_t[]> buffers_;
  std::vector<iovec> parts_;
  std::vector<sockaddr_in> senders_;
  std::vector<mmsghdr> headers_;
  struct alignas(cmsghdr) Stamp {
    std::array<char, CMSG_SPACE(sizeof(timespec))> bytes;
  };
  std::vector<Stamp> stamps_;
  Reassembly reassembly_;
  std::int64_t malformed_ = 0;
};

// Sends LCM_SELF_TEST through a socket pair of its own; false if it does not arrive.
bool multicast_is_heard(const UdpmAddress& address);

}  // namespace twinrate

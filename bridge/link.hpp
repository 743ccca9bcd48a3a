// The line to a drive: bytes out, bytes in.
//
//   /dev/ttyACM0, a pty    raw serial line at `baud`, to 4 Mbaud; held by this process alone
//   udp://HOST:PORT        datagrams to and from one address
//
// Never blocks on writing. Bytes that do not fit are discarded and counted: a disconnected drive
// must not stop the host, and must not get old commands when it returns. The device's end of a pty
// keeps up to 1 MiB, in place of the buffers of a real line's driver. Throws MachineError if the
// line cannot be opened, BadInput if its name is malformed.
#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace twinrate {

class Link {
 public:
  virtual ~Link() = default;
  // Waits at most this long for bytes, and returns all that are there; empty: none. A line that has
  // ended (cable pulled) gives none, and is_open() is false.
  std::span<const std::uint8_t> receive(double timeout_ms);
  void send(std::span<const std::uint8_t> bytes);
  bool is_open() const { return open_; }
  std::int64_t unsent() const { return unsent_; }  // writes that did not fit

 protected:
  explicit Link(int fd, std::size_t keeps = 0) : fd_(fd), keeps_(keeps) {}
  int fd_;
  bool open_ = true;

 private:
  virtual std::int64_t read_some(std::uint8_t* to, std::size_t size) = 0;
  virtual std::int64_t write_some(const std::uint8_t* from, std::size_t size) = 0;
  bool flush();
  std::size_t keeps_;
  std::vector<std::uint8_t> kept_;
  std::int64_t unsent_ = 0;
  std::vector<std::uint8_t> bytes_;
};

std::unique_ptr<Link> open_link(const std::string& port, int baud);

// The device's end: a new pty with the symbolic link `path` to it, which is removed at the end.
// Throws BadInput if the name is taken by something other than a symbolic link.
std::unique_ptr<Link> make_pty(const std::string& path);
// Receives at HOST:PORT; sends to the last sender.
std::unique_ptr<Link> listen_udp(const std::string& host_port);

// CLOCK_MONOTONIC.
std::int64_t now_ns();

}  // namespace twinrate

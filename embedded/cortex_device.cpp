#include "embedded/cortex_device.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>

#include "core/rates.hpp"
#include "embedded/instruction_counts.hpp"

namespace twinrate {
namespace {

constexpr int kPatience_ms = 20000;
constexpr double kSysTick_Hz = 25e6;

}  // namespace

CortexDevice::CortexDevice(const m3::Settings& settings, CortexLink link, double period_s,
                           bool sends_gains) {
  if (const std::string why = why_no_cortex(); !why.empty()) throw MachineError(why);
  if (link == CortexLink::kSemihosting)
    for (const char* name : {"/to_device", "/from_device"})
      if (mkfifo((scratch_.path() + name).c_str(), 0600) != 0) fail("cannot make a FIFO");
  start_emulator(link);
  link == CortexLink::kSemihosting ? open_fifos() : open_socket();
  const m3::Start start{
      settings, static_cast<std::uint32_t>(std::lround(kSysTick_Hz * period_s)) - 1, sends_gains};
  send(&start, sizeof start);
  const std::uint32_t crc = twp_crc32(reinterpret_cast<const std::uint8_t*>(&start), sizeof start);
  send(&crc, sizeof crc);
}

CortexDevice::~CortexDevice() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  if (to_ >= 0) close(to_);
  if (from_ >= 0 && from_ != to_) close(from_);
}

void CortexDevice::fail(const std::string& why) const {
  throw MachineError("emulated Cortex-M3: " + why);
}

void CortexDevice::start_emulator(CortexLink link) {
  const std::string image = cortex_directory() + "/loop.elf";
  pid_ = fork();
  if (pid_ < 0) fail("fork failed");
  if (pid_ > 0) return;
  const int null = open("/dev/null", O_RDWR);
  for (const int fd : {0, 1, 2}) dup2(null, fd);
  if (chdir(scratch_.path().c_str()) != 0) _exit(127);
  const char* socket = "socket,id=uart,path=uart,server=on,wait=off";
  if (link == CortexLink::kUart)
    execlp("qemu-system-arm", "qemu-system-arm", "-M", "mps2-an385", "-display", "none", "-monitor",
           "none", "-chardev", socket, "-serial", "chardev:uart", "-semihosting-config",
           "enable=on,target=native", "-icount", "shift=5,sleep=off", "-kernel", image.c_str(),
           nullptr);
  else
    execlp("qemu-system-arm", "qemu-system-arm", "-M", "mps2-an385", "-display", "none", "-monitor",
           "none", "-serial", "null", "-semihosting-config", "enable=on,target=native", "-icount",
           "shift=5,sleep=off", "-kernel", image.c_str(), nullptr);
  _exit(127);
}

// Opened for both directions, so that open() does not wait for the other side.
void CortexDevice::open_fifos() {
  to_ = open((scratch_.path() + "/to_device").c_str(), O_RDWR | O_CLOEXEC);
  from_ = open((scratch_.path() + "/from_device").c_str(), O_RDWR | O_CLOEXEC);
  if (to_ < 0 || from_ < 0) fail("cannot open a FIFO");
}

void CortexDevice::open_socket() {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::snprintf(address.sun_path, sizeof address.sun_path, "%s/uart", scratch_.path().c_str());
  to_ = from_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  for (int attempt = 0; attempt < kPatience_ms / 10; ++attempt) {
    if (connect(to_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return;
    usleep(10000);
  }
  fail("its UART cannot be reached");
}

void CortexDevice::send(const void* bytes, std::size_t size) {
  const auto* at = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t n = write(to_, at, size);
    if (n <= 0) fail(std::strerror(errno));
    at += n;
    size -= static_cast<std::size_t>(n);
  }
}

void CortexDevice::receive() {
  for (;;) {
    if (const auto zero = pending_.find('\0'); zero != std::string::npos) {
      const bool whole = m3::read_answer(reinterpret_cast<const std::uint8_t*>(pending_.data()),
                                         zero, answer_, gain_);
      pending_.erase(0, zero + 1);
      if (!whole) fail("a damaged frame");
      return;
    }
    pollfd ready{from_, POLLIN, 0};
    if (poll(&ready, 1, kPatience_ms) <= 0) fail("no answer within 20 s");
    char bytes[512];
    const ssize_t n = read(from_, bytes, sizeof bytes);
    if (n <= 0) fail("it ended");
    pending_.append(bytes, static_cast<std::size_t>(n));
  }
}

const m3::Answer& CortexDevice::tick(const Measurement& m) {
  twp_frame frame{};
  frame.header.type = TWP_SAMPLE;
  frame.header.flags = TWP_CURRENTS | TWP_VOLTAGE;
  frame.header.seq = static_cast<std::uint32_t>(m.k);
  frame.header.time_us = static_cast<std::uint32_t>(m.t_ns / 1000);
  frame.body.sample = sample_of(m);
  return exchange(frame);
}

const m3::Answer& CortexDevice::ask(std::int64_t k) {
  twp_frame frame{};
  frame.header.type = TWP_CLEAR;
  frame.header.seq = static_cast<std::uint32_t>(k);
  return exchange(frame);
}

const m3::Answer& CortexDevice::exchange(const twp_frame& frame) {
  std::uint8_t wire[TWP_MAX_WIRE];
  send(wire, twp_write(&frame, wire));
  receive();
  if (answer_.k != frame.header.seq) fail("an answer to another tick");
  return answer_;
}

Gain gain_of(const m3::NewGain& raw, const DriveConfig& drive) {
  using Q = m3::Format32;
  const m3::Units<Q> unit;
  Gain g;
  g.k = raw.k;
  g.t_ns = drive.t_ns(raw.k);
  g.first_use = first_use_of(drive.gain.policy, raw.k, drive.background_rate());
  g.n_x = 4;
  g.n_y = 2;
  g.theta_e = m3::angle_of(raw.theta);
  for (int i = 0; i < 8; ++i)
    g.K(i / 2, i % 2) = std::ldexp(raw.K[i], -Q::kK) * unit.of_state(i / 2);
  const std::int32_t* P = raw.P;
  for (int i = 0; i < 4; ++i)
    for (int j = i; j < 4; ++j) g.P(i, j) = g.P(j, i) = std::ldexp(*P++, -Q::kP) * unit.of_P(i, j);
  return g;
}

FixedEstimate estimate_of(const m3::Answer& a) {
  return {a.i_alpha, a.i_beta, a.omega, a.theta, a.gain_snapshot};
}

}  // namespace twinrate

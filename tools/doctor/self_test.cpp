// The loopback self-tests of `twinrate doctor`: one message through the sockets of a set, and a real
// publish and receive of liblcm, in a child process.
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <lcm/lcm-cpp.hpp>

#include "core/bus.hpp"
#include "core/machine_error.hpp"
#include "core/multicast.hpp"
#include "tools/doctor/checks.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;
constexpr int kMessages = 100;
constexpr int kTimeout_ms = 5000;

// Result of the child, sent through the pipe.
struct Outcome {
  int heard = 0;
  double worst_us = 0, mean_us = 0;
};

std::string private_url(const std::string& address) {
  const auto now = static_cast<std::uint64_t>(Clock::now().time_since_epoch().count());
  const auto port = 10000 + (now / 1000 + static_cast<std::uint64_t>(getpid()) * 7919) % 22768;
  return fmt::format("udpm://{}:{}?ttl=0", address, port);
}

bool heard_by_the_sockets_of_a_set(const std::string& url) {
  try {
    Bus bus({.url = url});
    return true;
  } catch (const MachineError&) {
    return false;
  }
}

struct Ear {
  bool heard = false;
  void hear(const lcm::ReceiveBuffer*, const std::string&) { heard = true; }
};

// One message at a time, each timed from publish to handler.
Outcome talk_to_itself(const std::string& url) {
  Outcome outcome;
  Ear ear;
  lcm::LCM bus(url);
  if (!bus.good() || !bus.subscribe("TWINRATE_DOCTOR", &Ear::hear, &ear)) return outcome;
  if (bus.getFileno() < 0) return outcome;  // LCM's self-test failed: handle() would abort
  const char text[] = "hello";
  for (int i = 0; i < kMessages; ++i) {
    const auto sent = Clock::now();
    ear.heard = false;
    bus.publish("TWINRATE_DOCTOR", text, sizeof text);
    while (!ear.heard && Clock::now() - sent < std::chrono::seconds(1)) bus.handleTimeout(100);
    if (!ear.heard) return outcome;
    const double us = std::chrono::duration<double, std::micro>(Clock::now() - sent).count();
    outcome.worst_us = std::max(outcome.worst_us, us);
    outcome.mean_us += us / kMessages;
    ++outcome.heard;
  }
  return outcome;
}

[[noreturn]] void be_the_child(const std::string& url, int pipe_out) {
  const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
  dup2(nowhere, STDERR_FILENO);  // hides LCM's general advice
  const Outcome outcome = talk_to_itself(url);
  const bool told = write(pipe_out, &outcome, sizeof outcome) == sizeof outcome;
  _exit(told ? 0 : 1);
}

// Waits for the result of the child; empty after the time-out.
Outcome answer_of(pid_t child, int pipe_in) {
  Outcome outcome;
  pollfd waiting{.fd = pipe_in, .events = POLLIN, .revents = 0};
  const bool answered = poll(&waiting, 1, kTimeout_ms) == 1 &&
                        read(pipe_in, &outcome, sizeof outcome) == sizeof outcome;
  if (!answered) kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  return answered ? outcome : Outcome{};
}

}  // namespace

Finding check_lcm_loopback(const std::string& address) {
  const std::string url = private_url(address);
  // The stock programs and a set use different sockets: one may be heard if the other is not.
  if (!heard_by_the_sockets_of_a_set(url))
    return {"lcm", Severity::kFail,
            "a message of the sockets that `launch` uses does not come back", multicast_mend()};
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0)
    return {"lcm", Severity::kFail, std::string("no pipe: ") + std::strerror(errno),
            "ulimit -n 1024"};
  const pid_t child = fork();
  if (child == 0) be_the_child(url, ends[1]);
  close(ends[1]);
  const Outcome outcome = child > 0 ? answer_of(child, ends[0]) : Outcome{};
  close(ends[0]);
  if (outcome.heard == kMessages)
    return {"lcm", Severity::kOk,
            fmt::format("{} messages published, all heard: {:.0f} us each, {:.0f} us the worst",
                        kMessages, outcome.mean_us, outcome.worst_us),
            ""};
  return {"lcm", Severity::kFail,
          fmt::format("published, {} of {} messages came back (a firewall, or no loopback)",
                      outcome.heard, kMessages),
          multicast_mend()};
}

}  // namespace twinrate

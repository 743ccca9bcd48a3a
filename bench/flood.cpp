// A flood of mutated messages against a launched set: what the drive does, and whether its log is
// that of the undisturbed run.
//
//   flood --set TWINRATE [--drive NAME] [--messages 10000] [--per-ms 20] [--paces lockstep,wall,..]
//         [--seed 1] [--override KEY=VALUE..]
//
// The flooder hears the bus, so every message has the right session id. It sends --messages of each
// channel, made from the messages heard last:
//
//   bits       1 to 8 bits of the message are others
//   tick       another tick: the present one, the next ones, an old one, or any number
//   values     numbers that are not finite, or far too large
//   text       the length of a text is 0, negative or 2^31-1
//   cut, long  any part of the message; bytes after its end
//   other      the message of another channel
//   tag        the message itself without its tag, or with any
//   again      the message itself, with its valid tag, as heard up to some seconds before
//   fragment   an LC03 datagram that announces any size, number and offset
//   datagram   bytes that are none of LCM's
//
// It has no token: it uses it only to tell what it hears of the set from what it sent itself. It has
// the normal scheduler. As expected: the run ends locked
// with exit code 0 and, in the paces of lock-step, every message of every tick is that of the run
// without the flood, but for session, host_ns and tag. Exit code 1 if a run is not.
#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "bench/child.hpp"
#include "bench/command_line.hpp"
#include "bench/log_digest.hpp"
#include "core/lcm_socket.hpp"
#include "core/message_tag.hpp"
#include "core/report_error.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

struct Options {
  std::string drive = "dilys2021", twinrate;
  std::vector<std::string> paces = {"lockstep", "wall", "realtime"}, overrides;
  int messages = 10000, per_ms = 20, seed = 1;
  double duration_s = 0;  // 0: as long as the flood takes
};

class Draw {
 public:
  explicit Draw(int seed) : state_(splitmix64(static_cast<std::uint64_t>(seed))) {}
  std::uint64_t any() { return state_ = splitmix64(state_); }
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(any() % count); }

 private:
  std::uint64_t state_;
};

void put(Bytes& bytes, std::size_t at, std::uint64_t value, std::size_t count) {
  for (std::size_t i = 0; i < count && at + i < bytes.size(); ++i)
    bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * (count - 1 - i)));
}

std::uint64_t number_at(const Bytes& bytes, std::size_t at) {
  std::uint64_t value = 0;
  for (std::size_t i = at; i < at + 8; ++i) value = value << 8 | bytes[i];
  return value;
}

// -- what is heard and what is sent ---------------------------------------------------------------

constexpr std::size_t kSeqAt = 8, kBodyAt = 32;  // after fingerprint, seq, t_ns, session
constexpr std::size_t kKept = 4096;

class Flooder {
 public:
  Flooder(const UdpmAddress& address, int seed)
      : receiver_(address, 64),
        sender_(address),
        socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)),
        draw_(seed) {
    to_.sin_family = AF_INET;
    to_.sin_port = htons(address.port);
    to_.sin_addr.s_addr = address.group;
    const auto ttl = std::uint8_t{0};
    setsockopt(socket_.get(), IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  }
  void knows(const Token& token) { tagger_.emplace(token); }
  // Keeps the messages of the set.
  void listen() {
    while (receiver_.read_now())
      for (LcmMessage message; receiver_.next(message);)
        for (const ChannelInfo& channel : kChannels)
          if (message.channel == channel.name && message.size >= kBodyAt + kTagBytes &&
              tagger_->is_genuine(message.channel, message.bytes, message.size))
            keep(channel.channel, Bytes(message.bytes, message.bytes + message.size));
  }
  void send_one(Channel channel) {
    const std::string name = info(channel).name;
    Bytes bytes = heard(channel);
    switch (draw_.below(11)) {
      case 0:
        for (std::size_t i = 0, bits = 1 + draw_.below(8); i < bits; ++i)
          bytes[draw_.below(bytes.size())] ^= static_cast<std::uint8_t>(1U << draw_.below(8));
        break;
      case 1:
        put(bytes, kSeqAt, other_tick(number_at(bytes, kSeqAt)), 8);
        break;
      case 2:
        for (std::size_t i = 0; i < 3; ++i) put(bytes, somewhere(bytes), bad_number(), 8);
        break;
      case 3:
        put(bytes, somewhere(bytes), bad_length(), 4);
        break;
      case 4:
        bytes.resize(draw_.below(bytes.size()));
        break;
      case 5:
        bytes.resize(bytes.size() + 1 + draw_.below(20000), std::uint8_t{0x5a});
        break;
      case 6:
        bytes = heard(static_cast<Channel>(draw_.below(kChannelCount)));
        break;
      case 7:
        put(bytes, bytes.size() - kTagBytes, draw_.below(2) == 0 ? 0 : draw_.any(), 8);
        break;
      case 8:
        bytes = earlier(channel);
        break;
      case 9:
        return send_fragment(name, bytes);
      default:
        return send_datagram(garbage());
    }
    sender_.send(name, bytes.data(), bytes.size());
  }

 private:
  void keep(Channel channel, Bytes bytes) {
    auto& kept = kept_[static_cast<std::size_t>(channel)];
    kept.push_back(std::move(bytes));
    if (kept.size() > kKept) kept.pop_front();
  }
  // A channel on which nobody spoke: the header of another one, its body drawn.
  Bytes heard(Channel channel) {
    const auto& kept = kept_[static_cast<std::size_t>(channel)];
    if (!kept.empty()) return kept.back();
    Bytes bytes(kBodyAt + 64 + draw_.below(200));
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(draw_.any());
    const auto& status = kept_[static_cast<std::size_t>(Channel::kStatus)];
    if (!status.empty()) std::copy_n(status.back().begin() + 8, kBodyAt - 8, bytes.begin() + 8);
    return bytes;
  }
  Bytes earlier(Channel channel) {
    const auto& kept = kept_[static_cast<std::size_t>(channel)];
    return kept.empty() ? heard(channel) : kept[draw_.below(kept.size())];
  }
  std::uint64_t other_tick(std::uint64_t k) {
    const std::array<std::uint64_t, 6> ticks = {
        k,
        k + 1,
        k + 2 + draw_.below(5000),
        draw_.below(std::max(std::size_t{k}, std::size_t{1})),
        std::uint64_t{1} << 62,
        draw_.any()};
    return ticks[draw_.below(ticks.size())];
  }
  std::uint64_t bad_number() {
    constexpr std::array<std::uint64_t, 5> kBad = {
        0x7ff8000000000000, 0x7ff0000000000000, 0xfff0000000000000,  // NaN, inf, -inf
        0x7fe0000000000000, 0x40c3880000000000};                     // 9e307, 1e4
    return kBad[draw_.below(kBad.size())];
  }
  std::uint64_t bad_length() {
    constexpr std::array<std::uint64_t, 4> kBad = {0, 0xffffffff, 0x7fffffff, 0x10000};
    return kBad[draw_.below(kBad.size())];
  }
  std::size_t somewhere(const Bytes& bytes) {
    return bytes.size() <= kBodyAt + 4 ? 0
                                       : kBodyAt + 4 * draw_.below((bytes.size() - kBodyAt) / 4);
  }
  Bytes garbage() {
    Bytes bytes(draw_.below(2000));
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(draw_.any());
    return bytes;
  }
  void send_fragment(const std::string& name, const Bytes& bytes) {
    Bytes datagram(kFragmentHeader);
    put(datagram, 0, kFragmentMagic, 4);
    put(datagram, 4, draw_.below(16), 4);
    put(datagram, 8, draw_.below(2) == 0 ? draw_.any() : 2 * bytes.size(), 4);
    put(datagram, 12, draw_.below(2) == 0 ? 0 : draw_.any(), 4);
    put(datagram, 16, draw_.below(3), 2);
    put(datagram, 18, draw_.below(2) == 0 ? 2 + draw_.below(3) : draw_.any(), 2);
    datagram.insert(datagram.end(), name.begin(), name.end());
    datagram.push_back(0);
    datagram.insert(datagram.end(), bytes.begin(), bytes.end());
    send_datagram(datagram);
  }
  void send_datagram(const Bytes& datagram) {
    sendto(socket_.get(), datagram.data(), std::min<std::size_t>(datagram.size(), 65000), 0,
           reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

  LcmReceiver receiver_;
  LcmSender sender_;
  FileDescriptor socket_;
  sockaddr_in to_{};
  Draw draw_;
  std::optional<Tagger> tagger_;
  std::array<std::deque<Bytes>, kChannelCount> kept_;
};

// -- one run --------------------------------------------------------------------------------------

struct Run {
  bool ended = false;  // by itself
  int exit_code = -1;
  double flood_s = 0, wall_s = 0;
  std::int64_t sent = 0;
  std::string out;
};

pid_t launch(const Options& o, const std::string& pace, const fs::path& dir, int port) {
  std::vector<std::string> list = {o.twinrate,
                                   "launch",
                                   o.drive,
                                   "--run-dir",
                                   dir.string(),
                                   "--duration",
                                   fmt::format("{}s", o.duration_s),
                                   "--pace",
                                   pace,
                                   "--lcm-url",
                                   fmt::format("udpm://239.255.76.67:{}?ttl=0", port)};
  for (const std::string& text : o.overrides) list.insert(list.end(), {"--set", text});
  return start(std::move(list), dir.string() + ".out", dir.string() + ".out");
}

// Floods once the log grows; --messages of each channel.
void flood(const Options& o, const fs::path& dir, Flooder& flooder, Run& run) {
  const auto begun = Clock::now();
  std::error_code error;
  while (!fs::exists(dir / "session.json") && seconds_since(begun) < 20) usleep(1000);
  flooder.knows(read_token((dir / kTokenFile).string()));
  while (fs::file_size(dir / "log.lcm", error) < 500'000 || error) {
    flooder.listen();
    if (seconds_since(begun) > 30) return;
    usleep(1000);
  }
  const auto from = Clock::now();
  const std::int64_t all = std::int64_t{o.messages} * kChannelCount;
  while (run.sent < all && fs::exists(dir / kTokenFile)) {
    flooder.listen();
    const auto due = static_cast<std::int64_t>(1e3 * seconds_since(from) * o.per_ms);
    for (; run.sent < std::min(due, all); ++run.sent)
      flooder.send_one(static_cast<Channel>(run.sent % kChannelCount));
    usleep(1000);
  }
  run.flood_s = seconds_since(from);
}

Run run_set(const Options& o, const std::string& pace, const fs::path& dir, bool flooded) {
  const int port = 20000 + getpid() % 10000;
  std::optional<Flooder> flooder;
  const pid_t pid = launch(o, pace, dir, port);
  Run run;
  const auto begun = Clock::now();
  if (flooded) {
    const sched_param normal{};
    sched_setscheduler(0, SCHED_OTHER, &normal);
    UdpmAddress address;
    inet_pton(AF_INET, "239.255.76.67", &address.group);
    address.port = static_cast<std::uint16_t>(port);
    flooder.emplace(address, o.seed);
    flood(o, dir, *flooder, run);
  }
  int status = 0;
  while (waitpid(pid, &status, WNOHANG) == 0 && seconds_since(begun) < 20 * o.duration_s + 60)
    usleep(5000);
  run.ended = WIFEXITED(status) && kill(pid, 0) != 0;
  if (!run.ended) {
    kill(pid, SIGKILL);
    waitpid(pid, &status, 0);
  }
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  run.wall_s = seconds_since(begun);
  std::ifstream file(dir.string() + ".out");
  std::stringstream text;
  text << file.rdbuf();
  run.out = text.str();
  return run;
}

// -- judgement ------------------------------------------------------------------------------------

std::string row_of(const std::string& out, const std::string& name) {
  std::istringstream lines(out);
  for (std::string line; std::getline(lines, line);)
    if (const auto at = line.find("  " + name); at == 0) {
      const auto from = line.find_first_not_of(' ', 2 + name.size());
      const auto words = line.find("  (", from);  // what the figure means
      return line.substr(from, words == std::string::npos ? words : words - from);
    }
  return "-";
}

std::string verdict_in(const fs::path& dir) {
  std::ifstream file(dir / "summary.json");
  const auto json = nlohmann::json::parse(file, nullptr, false);
  if (!json.is_object()) return "no summary";
  if (!json["trip"].is_null()) return "tripped";
  return json.value("locked", false) ? "locked" : "lost";
}

bool try_pace(const Options& o, const std::string& pace, const fs::path& scratch) {
  const fs::path calm = scratch / (pace + "-calm"), dir = scratch / (pace + "-flooded");
  const Run flooded = run_set(o, pace, dir, true);
  const std::string verdict = verdict_in(dir);
  bool well = flooded.ended && flooded.exit_code == 0 && verdict == "locked" &&
              flooded.sent == std::int64_t{o.messages} * kChannelCount;
  std::string same = "-";
  if (pace != "realtime") {
    run_set(o, pace, calm, false);
    const bool equal = well && digest_of(calm) == digest_of(dir);
    same = equal ? "bit for bit" : "no";
    well = well && equal;
  }
  fmt::print("| {} | {} in {:.1f} s | {}, exit code {} | {} | {} | {} | {} |\n", pace, flooded.sent,
             flooded.flood_s, verdict, flooded.exit_code, same,
             row_of(flooded.out, "messages refused"), row_of(flooded.out, "messages lost"),
             row_of(flooded.out, "late"));
  if (!well) fmt::print(stderr, "{}\n", flooded.out);
  std::fflush(stdout);
  return well;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("A flood of mutated messages against a launched set");
  Options o;
  command_line.option("--set", &o.twinrate, "launch the set of this twinrate").required();
  command_line.option("--drive", &o.drive, "run this drive file or preset");
  command_line.option("--messages", &o.messages, "messages of each channel");
  command_line.option("--per-ms", &o.per_ms, "messages a millisecond");
  command_line.option("--paces", &o.paces, "paces to try").by_comma();
  command_line.option("--seed", &o.seed, "draw the messages from this seed");
  command_line.option("--duration-s", &o.duration_s, "drive time of a run, s");
  command_line.option("--override", &o.overrides, "a key of the drive file: key.path=value")
      .one_value_each();
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (o.duration_s <= 0) o.duration_s = 10;
  char pattern[] = "/tmp/flood-XXXXXX";
  const std::filesystem::path scratch = mkdtemp(pattern);
  fmt::print(
      "| pace | messages | run | log as undisturbed | refused | lost | late |\n"
      "|---|---|---|---|---|---|---|\n");
  std::fflush(stdout);
  bool well = true;
  for (const std::string& pace : o.paces) well = try_pace(o, pace, scratch) && well;
  std::error_code ignored;
  if (well) std::filesystem::remove_all(scratch, ignored);
  return well ? 0 : 1;
} catch (...) {
  return twinrate::report_error("flood");
}

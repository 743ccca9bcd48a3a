// twinrate-logger: every channel -> LCM log, lossless, with an account of losses.
//
// Lock-step, bound to a session: acknowledges whole ticks and requests missing messages; the plant
// waits if it is a window ahead. Otherwise: writes messages in the order of arrival and counts
// gaps. The account is written to RUN_DIR/logger.json.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/decode.hpp"
#include "core/event_log.hpp"
#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "logger/tick_log.hpp"

namespace twinrate {
namespace {

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::string account_in(const std::string& directory) {
  return (std::filesystem::path(directory) / "logger.json").string();
}

// Throws BadInput if the directory holds the account of another logger.
std::string directory_of(const ProcessOptions& options) {
  const std::string directory = options.run_dir.empty() ? "." : options.run_dir;
  if (name_is_taken(account_in(directory)))
    throw BadInput(account_in(directory) + ": exists and is not overwritten; give another --out");
  return directory;
}

// The remains of an earlier logger of the run: the parts of its log, the last one possibly
// truncated.
struct Earlier {
  std::vector<std::string> parts;
  std::int64_t t0_us = 0;

  static Earlier in(const std::string& directory, bool resume) {
    Earlier earlier;
    if (!resume) return earlier;
    earlier.parts = log_parts(directory);
    EventLog first(earlier.parts.front(), OnDamage::kSkip);
    const lcm::LogEvent* manifest = first.next();  // written at drive time 0
    earlier.t0_us = manifest ? manifest->timestamp : wall_us();
    return earlier;
  }
  // Each part ends with its last whole event.
  void cut_to_whole_events() const {
    for (const std::string& part : parts) {
      EventLog events(part, OnDamage::kSkip);
      std::int64_t end = 0;
      while (const lcm::LogEvent* event = events.next())
        end = events.place().byte + 28 + static_cast<std::int64_t>(event->channel.size()) +
              event->datalen;
      std::error_code refused;
      const auto size = static_cast<std::int64_t>(std::filesystem::file_size(part, refused));
      if (end > 0 && end < size) std::filesystem::resize_file(part, end, refused);
      if (refused) fmt::print(stderr, "{}: {}\n", part, refused.message());
    }
  }
};

class LoggerProcess {
 public:
  explicit LoggerProcess(Process& p)
      : p_(p),
        directory_(directory_of(p.options())),
        earlier_(Earlier::in(directory_, p.options().resume)),
        t0_us_(p.options().resume ? earlier_.t0_us : wall_us()),
        writer_(directory_, static_cast<std::int64_t>(p.bus_parameters().log_rotate_MB * 1e6),
                earlier_.parts.size()),
        log_(writer_,
             p.lockstep() && p.bus().bound() ? TickLog::Order::kByTick : TickLog::Order::kAsItComes,
             p.drive(), p.options().channel_suffix, t0_us_),
        ack_every_(std::max(1, p.bus_parameters().window_ticks / 8)) {
    log_.follow(rate_history(p.config()));
    p.on_steering({.follow = [this](const SteeredDrive& now) { log_.follow(now.rates()); }});
    p.on_applied([this](const std::string& lines, std::int64_t k) { write_steering(lines, k); });
    log_.admit_ahead(p.bus_parameters().window_ticks + kKeptBeyondWindow);
    if (p.bus_parameters().split_ports) log_.expect_no_order();
    if (!p.options().resume) write_manifest(t0_us_);
    p.bus().subscribe_all([this](Channel channel, const std::uint8_t* bytes, std::size_t size,
                                 std::int64_t seq,
                                 std::int64_t t_ns) { take(channel, bytes, size, seq, t_ns); });
    p.waiting_for([this] {
      return Waiting{fmt::format("messages of tick {}", log_.complete_below()),
                     Patience::kForWholeTicks};
    });
  }
  void run() {
    p_.ready();
    p_.run([this] {
      ask_for_missing();
      acknowledge();
    });
    drain();
    log_.close();
    if (!writer_.finish()) disk_full();
    earlier_.cut_to_whole_events();
    write_account();
  }

 private:
  void write_manifest(std::int64_t t_us) {
    const manifest_t manifest =
        make_manifest(p_.bus().session(), p_.config().merged(),
                      describe_host_json(p_.bus().session(), p_.drive().run.seed));
    writer_.set_manifest(info(Channel::kManifest).name + p_.options().channel_suffix,
                         encode(manifest), t_us);
    if (p_.bus().bound()) p_.bus().publish(manifest);
  }
  // A datagram may be lost. This process takes part in every request and needs none.
  void write_steering(const std::string& lines, std::int64_t k) {
    event_t event = make_event({.role = Role::kLogger,
                                .reason = Reason::kSteered,
                                .k = k,
                                .t_ns = p_.drive().t_ns(k),
                                .text = lines},
                               p_.bus().session());
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(event.getEncodedSize()));
    event.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    log_.take(Channel::kEvent, event.seq, event.t_ns, bytes.data(), bytes.size());
  }
  static bool tells_of_steering(const std::uint8_t* bytes, std::size_t size) {
    event_t event;
    return decode(event, bytes, size) && event.reason == static_cast<int>(Reason::kSteered);
  }
  // Readers of the log refuse such a message (core/event_log.hpp).
  bool at_a_wrong_time(Channel channel, std::int64_t seq, std::int64_t t_ns) const {
    return channel < Channel::kStatus && p_.in_turn() && t_ns != p_.drive().t_ns(seq);
  }
  // A continued log begins with a tick: only the messages of a tick show how late it is.
  bool waits_for_a_tick(Channel channel, std::int64_t t_ns) {
    if (!p_.options().resume || resumed_) return false;
    if (channel >= Channel::kStatus) return true;
    write_manifest(t0_us_ + t_ns / 1000);
    resumed_ = true;
    return false;
  }
  void take(Channel channel, const std::uint8_t* bytes, std::size_t size, std::int64_t seq,
            std::int64_t t_ns) {
    if (channel == Channel::kManifest && p_.bus().bound()) return;  // already written at the start
    if (waits_for_a_tick(channel, t_ns)) return;
    if (channel == Channel::kEvent && tells_of_steering(bytes, size)) return;  // has been written
    const std::int64_t before = log_.complete_below();
    if (at_a_wrong_time(channel, seq, t_ns)) return p_.bus().refuse();
    if (!log_.take(channel, seq, t_ns, bytes, size)) return p_.bus().refuse();
    if (channel == Channel::kEstimate) p_.gains_every_nth(log_.gain_rate());
    if (log_.complete_below() != before) p_.progress(log_.complete_below() - 1);
    // The plant waits for the last tick: at once.
    const bool last = log_.complete_below() == p_.drive().steps();
    if (log_.complete_below() >= acknowledged_ + (last ? 1 : ack_every_)) acknowledge();
    if (writer_.take_rotated())
      p_.event(Reason::kLogRotated, log_.complete_below(),
               "log continues in " + writer_.files().back());
    if (writer_.full()) disk_full();
  }
  // After a stop: logs the messages that have arrived, for at most 2 s.
  void drain() {
    const auto begun = std::chrono::steady_clock::now();
    while (!writer_.full() && p_.bus().handle(5) &&
           std::chrono::steady_clock::now() - begun < std::chrono::seconds(2)) {
    }
  }
  // Flushes before it acknowledges.
  void acknowledge() {
    if (!writer_.flush()) {
      disk_full();
      return;
    }
    acknowledged_ = log_.complete_below();
    ack_t ack = missing_;
    ack.seq = acknowledged_;
    missing_ = ack_t{};
    // Only a logger that is bound to the session may release its plant.
    if (p_.bus().bound()) p_.bus().publish(ack);
  }
  // Only when the bus is silent: missing messages of the newest ticks are usually in transit.
  void ask_for_missing() {
    for (const TickLog::Missing& missing : log_.missing(32)) {
      missing_.missing_channel[missing_.n_missing] = static_cast<std::int32_t>(missing.channel);
      missing_.missing_seq[missing_.n_missing++] = missing.seq;
    }
    if (missing_.n_missing > 0) ++p_.status().repeats;
  }
  void disk_full() {
    if (p_.stopping() && full_said_) return;
    full_said_ = true;
    p_.fail(Reason::kDiskFull, log_.complete_below(),
            p_.in_turn() ? fmt::format("{}; the log holds {} whole ticks", writer_.failure(),
                                       writer_.marked_on_disk())
                         : fmt::format("{}; the log ends before tick {}", writer_.failure(),
                                       writer_.marked_on_disk()));
  }
  void write_account() {
    nlohmann::ordered_json channels;
    for (const ChannelInfo& channel : kChannels) {
      if (channel.channel == Channel::kAck) continue;
      const ChannelAccount& a = log_.account(channel.channel);
      channels[channel.name] = {
          {"received", a.received}, {"lost", a.lost}, {"duplicates", a.duplicates}};
    }
    std::vector<std::string> files;
    for (const std::string& file : earlier_.parts)
      files.push_back(std::filesystem::path(file).filename().string());
    for (const std::string& file : writer_.files())
      files.push_back(std::filesystem::path(file).filename().string());
    try {
      write_new(account_in(directory_),
                nlohmann::ordered_json{{"files", files}, {"channels", channels}}.dump(2) + "\n");
    } catch (const std::runtime_error& error) {
      fmt::print(stderr, "twinrate-logger: {}\n", error.what());
    }
  }

  Process& p_;
  std::string directory_;
  Earlier earlier_;
  std::int64_t t0_us_;  // wall time of drive time 0
  LogWriter writer_;
  TickLog log_;
  ack_t missing_{};  // requested with the next acknowledgement
  std::int64_t ack_every_, acknowledged_ = 0;
  bool full_said_ = false, resumed_ = false;
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({.role = Role::kLogger,
                      .program = "twinrate-logger",
                      .purpose = "every channel -> LCM log and loss account in --out",
                      .drain_every_ms = 1},
                     argc, argv, [](Process& p) { LoggerProcess(p).run(); });
}

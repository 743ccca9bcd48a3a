// twinrate-logger: every channel -> LCM log, lossless, with an account of losses.
//
// Lock-step, bound to a session: acknowledges whole ticks and requests missing messages; the plant
// waits if it is a window ahead. Otherwise: writes messages in the order of arrival and counts
// gaps. The account is written to RUN_DIR/logger.json.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>

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

class LoggerProcess {
 public:
  explicit LoggerProcess(Process& p)
      : p_(p),
        directory_(directory_of(p.options())),
        writer_(directory_, static_cast<std::int64_t>(p.bus_parameters().log_rotate_MB * 1e6)),
        log_(writer_,
             p.lockstep() && p.bus().bound() ? TickLog::Order::kByTick : TickLog::Order::kAsItComes,
             p.drive(), p.options().channel_suffix, t0_us_),
        ack_every_(std::max(1, p.bus_parameters().window_ticks / 8)) {
    log_.admit_ahead(p.bus_parameters().window_ticks + kKeptBeyondWindow);
    if (p.bus_parameters().split_ports) log_.expect_no_order();
    write_manifest();
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
    if (!writer_.flush()) disk_full();
    write_account();
  }

 private:
  void write_manifest() {
    const manifest_t manifest =
        make_manifest(p_.bus().session(), p_.config().merged(),
                      describe_host_json(p_.bus().session(), p_.drive().run.seed));
    writer_.set_manifest(info(Channel::kManifest).name + p_.options().channel_suffix,
                         encode(manifest), t0_us_);
    if (p_.bus().bound()) p_.bus().publish(manifest);
  }
  // Readers of the log refuse such a message (core/event_log.hpp).
  bool at_a_wrong_time(Channel channel, std::int64_t seq, std::int64_t t_ns) const {
    return channel < Channel::kStatus && p_.in_turn() && t_ns != p_.drive().t_ns(seq);
  }
  void take(Channel channel, const std::uint8_t* bytes, std::size_t size, std::int64_t seq,
            std::int64_t t_ns) {
    if (channel == Channel::kManifest && p_.bus().bound()) return;  // already written at the start
    const std::int64_t before = log_.complete_below();
    if (at_a_wrong_time(channel, seq, t_ns)) return p_.bus().refuse();
    if (!log_.take(channel, seq, t_ns, bytes, size)) return p_.bus().refuse();
    if (channel == Channel::kEstimate) p_.gains_every_nth(log_.gain_rate());
    if (log_.complete_below() != before) p_.progress(log_.complete_below() - 1);
    if (log_.complete_below() >= acknowledged_ + ack_every_) acknowledge();
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
    // A logger that is not bound to the session must not release its plant.
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
            fmt::format("{}; the log holds {} whole ticks", writer_.failure(),
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
  std::int64_t t0_us_ = wall_us();  // wall time of drive time 0
  std::string directory_;
  LogWriter writer_;
  TickLog log_;
  ack_t missing_{};  // requested with the next acknowledgement
  std::int64_t ack_every_, acknowledged_ = 0;
  bool full_said_ = false;
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process(
      {Role::kLogger, "twinrate-logger", "every channel -> LCM log and loss account in --out"},
      argc, argv, [](Process& p) { LoggerProcess(p).run(); });
}

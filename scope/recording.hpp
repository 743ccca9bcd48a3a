// Everything that the scope stores of one drive: the history of its signals, its events, its
// processes, the trigger and its captures. The same for a live drive and for a log.
//
//   whole messages (core/bus, core/event_log) -> take() -> TickStore, Trigger, events
//   page -> Api (scope/api.hpp) -> the functions below
//
// Thread-safe: take() locks for one message, a reader for the reduction of one signal. A capture is
// complete when every channel with a message each tick has passed its end, or kSlackTicks later.
#pragma once
#include <array>
#include <deque>
#include <map>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/steering.hpp"
#include "core/watched_channel.hpp"
#include "scope/signal_table.hpp"
#include "scope/tick_store.hpp"
#include "scope/trigger.hpp"

namespace twinrate::scope {

inline constexpr std::size_t kCapturesKept = 10, kEventsKept = 5000;
inline constexpr std::int64_t kSlackTicks = 256, kLateTicks = 64, kMaxCaptureTicks = 200'000;

struct ScopeEvent {
  std::int64_t k = -1, t_ns = 0;
  std::string role, reason, text;
  bool trip = false;
};

// Ticks [from, to) at the full rate.
struct Capture {
  int id = 0;
  std::int64_t trigger_k = 0, from = 0, to = 0;
  std::string cause;         // "estimate.omega_m_rad_s rising 100", "forced"
  std::int64_t missing = 0;  // ticks of which it lacks a message
  TickStore ticks{SIZE_MAX};
};

// Values of the drive file that the scope uses; 0 and "" if it has none.
struct DriveFileFacts {
  std::string name, config_toml;
  bool imported = false;  // the load of the file was not applied
  double T_s = 0, duration_s = 0;
  int n_p = 0;
  double omega_m_max = 0, load_max_Nm = 0, rated_torque_Nm = 0, i_max_A = 0;  // max: of steering
};

// Source and range of a reader: the history (capture 0) or a capture.
struct Span {
  std::int64_t from = 0, to = 0, bucket = 1;
  int capture = 0;
};

struct Reduced {
  std::vector<double> min, max;  // of each bucket; kNoValue if it has no value
};

// A waiting thread gets the lock next: a thread that locks for each message cannot starve the
// readers.
class FairMutex {
 public:
  void lock() {
    const std::lock_guard next(next_);
    mutex_.lock();
  }
  void unlock() { mutex_.unlock(); }

 private:
  std::mutex next_, mutex_;
};

class Recording {
 public:
  // `history_s` of drive time, within `memory_bytes`.
  Recording(double history_s, std::size_t memory_bytes);

  // A message that passed is_whole_message(), in order of arrival.
  void take(Channel channel, const std::uint8_t* bytes, std::size_t size,
            const MessageHeader& header, std::int64_t arrival_us);
  // Sets the drive file of a drive whose DRIVE_MANIFEST was missed. Throws BadInput.
  void use_config(const std::string& config_toml, const std::string& source);
  void restart();                      // for another session
  void note_bus(std::int64_t now_us);  // rates and latencies, as signals; 20 a second
  void look(std::int64_t now_us);      // completes captures if messages have stopped

  Reduced reduce(const std::string& signal, const Span& span) const;
  // The value of every stride-th tick.
  std::vector<double> samples(const std::string& signal, const Span& span) const;
  Extent extent(const std::string& signal, const Span& span) const;

  void set_trigger(const TriggerSettings& settings);
  void force_trigger();
  TriggerSettings trigger() const;
  std::int64_t first_k() const;
  std::int64_t last_k() const;
  std::int64_t complete_k() const;  // every channel of the tick has passed it

  // "k", trigger, captures: a short text for every frame.
  nlohmann::ordered_json brief() const;
  // The tree of signals with the newest values, channels, processes.
  nlohmann::ordered_json tree(std::int64_t now_us) const;
  nlohmann::ordered_json events(std::size_t from) const;
  std::vector<ScopeEvent> event_list() const;
  // Directory of the drive's log, which contains the requests before the first received tick.
  void use_run_directory(const std::string& directory);
  // The applied requests in order; empty if some may be missing.
  std::optional<std::vector<AppliedSteering>> requests() const;
  DriveFileFacts drive() const;
  std::vector<Signal> signals() const;
  int generation() const;  // counts restarts
  std::int64_t undecodable() const;

 private:
  using Lock = std::lock_guard<FairMutex>;
  struct Derived {
    int angle_error, speed_error, u_d, u_q, u_abs, u_limit, i_alpha, i_beta, theta_e;
  };
  // Columns from which the derived signals are computed.
  struct Inputs {
    int est_theta, est_omega, truth_theta, truth_omega, u_alpha, u_beta, v_dc, i_a, i_b, i_c;
  };

  void clear();
  void add_derived_signals();
  void put(int column, std::int64_t k, double value);
  void derive(Channel channel, std::int64_t k);
  void derive_pair(std::int64_t k);
  void derive_voltage(std::int64_t k);
  void take_event(const std::uint8_t* bytes, std::size_t size);
  void take_status(const std::uint8_t* bytes, std::size_t size);
  void take_manifest(const std::uint8_t* bytes, std::size_t size);
  void measure_T_s(const MessageHeader& header);
  void begin_capture(std::int64_t k, const std::string& cause);
  std::vector<int> with_gaps(std::int64_t from, std::int64_t to);
  void complete_captures(bool standstill);
  std::int64_t passed_k() const;
  const TickStore* store_of(int capture) const;
  std::string trigger_cause() const;
  double rate_Hz(std::size_t channel, std::int64_t now_us) const;

  const double history_s_;
  const std::size_t memory_bytes_;
  mutable FairMutex mutex_;
  SignalTable signals_;
  Inputs inputs_{};
  Derived derived_{};
  TickStore store_;
  DriveFileFacts drive_;
  std::vector<WatchedChannel> channels_;
  // Message counts of the last second with their times, for readable rates.
  std::deque<std::pair<std::int64_t, std::array<std::int64_t, kChannelCount>>> counts_;
  TickTimes tick_times_;
  std::map<int, status_t> processes_;
  std::deque<ScopeEvent> events_;
  std::size_t events_before_ = 0;  // events dropped
  std::int64_t heard_from_k_ = -1, session_ = 0;
  std::string run_directory_;
  std::vector<double> newest_;  // by column
  Trigger trigger_;
  int trigger_column_ = -1;
  std::optional<Capture> pending_;
  std::deque<Capture> captures_;
  int captured_ = 0, generation_ = 0;
  std::optional<MessageHeader> first_header_;
  std::int64_t last_arrival_us_ = 0, undecodable_ = 0;
};

}  // namespace twinrate::scope

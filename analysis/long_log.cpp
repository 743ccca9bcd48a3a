#include "analysis/long_log.hpp"

#include <algorithm>
#include <deque>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>

#include "core/decode.hpp"
#include "core/run_log_part.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

// Messages in the order of a log -> ticks in the order of time.
class TickStream {
 public:
  using OnTick = std::function<void(const TickRow&)>;
  explicit TickStream(OnTick on_tick) : on_tick_(std::move(on_tick)) {}

  void take(Channel channel, const lcm::LogEvent& event) {
    switch (channel) {
      case Channel::kMeasurement:
        return put<measurement_t>(event);
      case Channel::kTruth:
        return put<truth_t>(event);
      case Channel::kEstimate:
        return put<estimate_t>(event);
      case Channel::kCommand:
        return put<command_t>(event);
      case Channel::kGain:
        return put_gain(event);
      default:
        return;
    }
  }
  void close() {
    while (!pending_.empty()) emit();
  }

 private:
  template <class Wire>
  void put(const lcm::LogEvent& event) {
    Wire wire{};
    if (!decode(wire, event.data, static_cast<std::size_t>(event.datalen))) return;
    if (wire.seq <= emitted_) return;
    TickRow& row = pending_[wire.seq];
    row.k = wire.seq;
    row.take(from_wire(wire));
    while (pending_.rbegin()->first - pending_.begin()->first > kReach) emit();
  }
  void put_gain(const lcm::LogEvent& event) {
    gain_t wire{};
    if (!decode(wire, event.data, static_cast<std::size_t>(event.datalen))) return;
    gains_.try_emplace(wire.seq, from_wire(wire));
    if (gains_.size() > 2 * static_cast<std::size_t>(kReach)) gains_.erase(gains_.begin());
  }
  void emit() {
    TickRow row = pending_.begin()->second;
    pending_.erase(pending_.begin());
    emitted_ = row.k;
    if (row.estimate && row.estimate->gain_seq >= 0) {
      gains_.erase(gains_.begin(), gains_.lower_bound(row.estimate->gain_seq));
      if (!gains_.empty() && gains_.begin()->first == row.estimate->gain_seq)
        row.gain = gains_.begin()->second;
    }
    on_tick_(row);
  }

  OnTick on_tick_;
  std::map<std::int64_t, TickRow> pending_;
  std::map<std::int64_t, TickRow::OfGain> gains_;  // from the one in use on
  std::int64_t emitted_ = std::numeric_limits<std::int64_t>::min();
};

// Adds the speed of reference_speed() to each tick. For a log without truth the speed is known half
// of kSlopeSpan_s later.
class SpeedAdded {
 public:
  SpeedAdded(bool has_truth, SummaryBuilder& builder) : has_truth_(has_truth), builder_(builder) {}
  void take(const TickRow& row) {
    if (has_truth_) {
      builder_.add(row, row.truth ? row.truth->omega_m : kNaN);
      return;
    }
    window_.push_back(row);
    while (next_ < window_.size() && time(window_.size() - 1) > time(next_) + kSlopeSpan_s / 2)
      add_next();
  }
  void close() {
    while (next_ < window_.size()) add_next();
  }

 private:
  static constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  double time(std::size_t i) const { return window_[i].t_s; }
  double position(std::size_t i) const {
    const auto& m = window_[i].measurement;
    return m && (m->signals & kPosition) ? m->theta_m : kNaN;
  }
  void add_next() {
    const double t_s = time(next_);
    while (time(0) < t_s - kSlopeSpan_s / 2) {
      window_.pop_front();
      --next_;
    }
    std::size_t to = next_;
    while (to + 1 < window_.size() && time(to + 1) <= t_s + kSlopeSpan_s / 2) ++to;
    const double omega_m =
        time(to) > time(0) ? (position(to) - position(0)) / (time(to) - time(0)) : kNaN;
    builder_.add(window_[next_], omega_m);
    ++next_;
  }

  bool has_truth_;
  SummaryBuilder& builder_;
  std::deque<TickRow> window_;
  std::size_t next_ = 0;
};

std::int64_t tick_of(const lcm::LogEvent& event) {
  std::uint64_t k = 0;
  for (int i = 8; i < 16 && event.datalen >= 16; ++i)
    k = k << 8 | static_cast<const std::uint8_t*>(event.data)[i];
  return static_cast<std::int64_t>(k);
}

// Chooses the last ticks; after a loss of synchronism the ticks around the loss, three quarters of
// them before it.
void choose_part(const RunOutline& outline, const DriveConfig& config, std::int64_t ticks_shown,
                 LongLog& found) {
  const RunOutline::Span& span = outline.span(Channel::kMeasurement);
  found.last_k = std::max(span.last, outline.span(Channel::kEstimate).last);
  if (found.summary.lost_at_s) {
    const auto lost_k = static_cast<std::int64_t>(*found.summary.lost_at_s / config.T_s());
    found.last_k = std::min(found.last_k, lost_k + ticks_shown / 4);
  }
  found.first_k = std::max(outline.first_k, found.last_k - ticks_shown + 1);
  found.begin_s = outline.begin_s;
  found.end_s = outline.end_s;
}

}  // namespace

bool is_long(const std::string& path) {
  constexpr std::int64_t kBytesOfATick = 900;
  std::int64_t bytes = 0;
  for (const std::string& part : log_parts(path)) {
    std::error_code ignored;
    bytes += static_cast<std::int64_t>(std::filesystem::file_size(part, ignored));
  }
  return bytes > kTicksShown * kBytesOfATick;
}

LongLog summarise_log(const std::string& path, const DriveConfig& config, OnDamage on_damage,
                      std::int64_t ticks_shown, AngleReference reference,
                      const std::string& channel_suffix) {
  RunOutline outline;
  TickStream rows([&](const TickRow& row) { outline.add(row); });
  const RunLog head = scan_run_log(path, channel_suffix, on_damage,
                                   [&](Channel channel, const lcm::LogEvent& event) {
                                     outline.add(channel, tick_of(event));
                                     rows.take(channel, event);
                                   });
  rows.close();
  LongLog found;
  SummaryBuilder builder(head, outline, config, reference);
  SpeedAdded with_speed(outline.has_truth(), builder);
  TickStream again([&](const TickRow& row) { with_speed.take(row); });
  scan_run_log(path, channel_suffix, on_damage,
               [&](Channel channel, const lcm::LogEvent& event) { again.take(channel, event); });
  again.close();
  with_speed.close();
  found.summary = builder.finish();
  choose_part(outline, config, ticks_shown, found);
  found.log = read_run_log_part(path, channel_suffix, on_damage, found.first_k, found.last_k,
                                config.rates.n);
  found.ticks = run_ticks(found.log);
  return found;
}

double window_of_part(const LongLog& part) {
  const std::optional<double> part_s = part.ticks.measured_from_s();
  if (!part_s) return part.summary.window_from_s;
  return std::max(0.0, part.summary.window_from_s - (*part_s - part.begin_s));
}

}  // namespace twinrate

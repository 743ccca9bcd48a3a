#include "scope/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/event_log.hpp"
#include "core/manifest.hpp"
#include "core/reason.hpp"
#include "core/steering_limits.hpp"

namespace twinrate::scope {
namespace {

constexpr double kBytesOfTick =
    560;  // of a dense history: 60 columns of 8.6 bytes, some sparse ones
constexpr std::int64_t kStandstill_us = 500'000, kRate_us = 1'000'000;

std::size_t chunks_for(double history_s, std::size_t memory_bytes, double T_s) {
  const double ticks =
      std::min(static_cast<double>(memory_bytes) / kBytesOfTick, T_s > 0 ? history_s / T_s : 1e18);
  return static_cast<std::size_t>(std::max(2.0, std::ceil(ticks / kChunkTicks) + 1));
}

bool ticks_every_time(Channel channel) {
  return channel < Channel::kStatus && channel != Channel::kGain;
}

}  // namespace

Recording::Recording(double history_s, std::size_t memory_bytes)
    : history_s_(history_s),
      memory_bytes_(memory_bytes),
      store_(chunks_for(history_s, memory_bytes, 0)) {
  clear();
}

void Recording::clear() {
  store_ = TickStore(chunks_for(history_s_, memory_bytes_, drive_.T_s));
  add_derived_signals();
  channels_.clear();
  for (const ChannelInfo& channel : kChannels) channels_.emplace_back(channel.channel);
  counts_.clear();
  processes_.clear();
  events_.clear();
  events_before_ = 0;
  heard_from_k_ = -1;
  newest_.clear();
  pending_.reset();
  captures_.clear();
  first_header_.reset();
  trigger_column_ = signals_.find(trigger_.settings().signal);
  trigger_.set(trigger_.settings());
}

void Recording::restart() {
  const Lock lock(mutex_);
  ++generation_;
  drive_ = {};
  clear();
}

void Recording::use_config(const std::string& config_toml, const std::string& source) {
  Config config = Config::parse(config_toml, source);
  const DriveConfig& d = config.drive();
  const SteeringLimits limits = steering_limits(d, steering_of(config));
  const Lock lock(mutex_);
  drive_ = {.name = d.name,
            .config_toml = config_toml,
            .T_s = d.T_s(),
            .duration_s = d.run.duration_s,
            .n_p = d.machine.n_p,
            .omega_m_max = limits.omega_m,
            .load_max_Nm = limits.load,
            .rated_torque_Nm = d.machine.T_rated,
            .i_max_A = d.machine.i_rated};
  if (store_.empty()) store_ = TickStore(chunks_for(history_s_, memory_bytes_, drive_.T_s));
}

void Recording::take(Channel channel, const std::uint8_t* bytes, std::size_t size,
                     const MessageHeader& header, std::int64_t arrival_us) {
  if (channel == Channel::kManifest) take_manifest(bytes, size);
  const Lock lock(mutex_);
  last_arrival_us_ = arrival_us;
  if (channel == Channel::kMeasurement) {
    if (heard_from_k_ < 0 || header.seq < heard_from_k_) heard_from_k_ = header.seq;
    session_ = header.session;
    tick_times_.note(header.seq, arrival_us);
    measure_T_s(header);
  }
  channels_[static_cast<std::size_t>(channel)].take(header, bytes, size, arrival_us, tick_times_);
  if (channel == Channel::kEvent) take_event(bytes, size);
  if (channel == Channel::kStatus) take_status(bytes, size);
  if (channel >= Channel::kStatus) return;
  read_numbers(layout_of(channel), bytes, size, [&](int field, int element, double value) {
    put(signals_.of_message(channel, "", field, element), header.seq, value);
  });
  derive(channel, header.seq);
  if (channel == Channel::kMeasurement && trigger_.automatic(header.seq))
    begin_capture(header.seq, "no trigger: by itself");
  if (pending_) complete_captures(false);
}

void Recording::put(int column, std::int64_t k, double value) {
  store_.set(column, signals_[column].dense, k, value);
  if (static_cast<std::size_t>(column) >= newest_.size())
    newest_.resize(static_cast<std::size_t>(column) + 1, kNoValue);
  newest_[static_cast<std::size_t>(column)] = value;
  if (column == trigger_column_ && !pending_ && trigger_.sample(k, value))
    begin_capture(k, trigger_cause());
}

// Without a drive file f_s is unknown: the control period is taken from the times of the messages.
void Recording::measure_T_s(const MessageHeader& header) {
  if (drive_.n_p > 0 || header.seq < 0) return;
  if (!first_header_ || header.seq < first_header_->seq) first_header_ = header;
  const std::int64_t ticks = header.seq - first_header_->seq;
  if (ticks >= 100 && drive_.T_s == 0)
    drive_.T_s =
        1e-9 * static_cast<double>(header.t_ns - first_header_->t_ns) / static_cast<double>(ticks);
}

void Recording::take_event(const std::uint8_t* bytes, std::size_t size) {
  event_t event{};
  if (!decode(event, bytes, size)) {
    ++undecodable_;
    return;
  }
  const char* name = reason_name(event.reason);
  ScopeEvent kept{.k = event.seq >= 0 ? event.seq : store_.last_k(),
                  .t_ns = event.t_ns,
                  .role = role_name(event.role),
                  .reason = name ? name : fmt::format("reason {}", event.reason),
                  .text = event.text,
                  .trip = is_trip(static_cast<Reason>(event.reason))};
  if (!pending_ && trigger_.event(kept.k, kept.reason, kept.trip))
    begin_capture(kept.k, "event " + kept.reason);
  events_.push_back(std::move(kept));
  if (events_.size() <= kEventsKept) return;
  events_.pop_front();
  ++events_before_;
}

// Stores the counts of a process as signals, at the tick that the process has reached.
void Recording::take_status(const std::uint8_t* bytes, std::size_t size) {
  status_t status{};
  if (!decode(status, bytes, size)) {
    ++undecodable_;
    return;
  }
  processes_[status.role] = status;
  const std::int64_t k =
      std::clamp<std::int64_t>(status.seq, 0, std::max<std::int64_t>(0, store_.last_k()));
  const std::string speaker = role_name(status.role);
  if (store_.empty() || speaker == "unknown role") return;
  read_numbers(layout_of(Channel::kStatus), bytes, size, [&](int field, int element, double value) {
    put(signals_.of_message(Channel::kStatus, speaker, field, element), k, value);
  });
}

void Recording::take_manifest(const std::uint8_t* bytes, std::size_t size) {
  manifest_t manifest{};
  if (!decode(manifest, bytes, size) || manifest.config_toml.empty()) return;
  try {
    use_config(manifest.config_toml, "DRIVE_MANIFEST");
    const Lock lock(mutex_);
    drive_.imported = imported_signals(manifest.manifest_json).has_value();
  } catch (const BadInput&) {  // of another version: the drive file stays unknown
    const Lock lock(mutex_);
    ++undecodable_;
  }
}

std::string Recording::trigger_cause() const {
  const TriggerSettings& t = trigger_.settings();
  const std::string edge = kEdgeNames[static_cast<int>(t.edge)];
  return t.edge == Edge::kChange ? fmt::format("{} {}", t.signal, edge)
                                 : fmt::format("{} {} {:.6g}", t.signal, edge, t.level);
}

void Recording::begin_capture(std::int64_t k, const std::string& cause) {
  const TriggerSettings& t = trigger_.settings();
  const auto before =
      static_cast<std::int64_t>(std::llround(t.pre_share * static_cast<double>(t.length_ticks)));
  pending_ = Capture{.id = ++captured_,
                     .trigger_k = k,
                     .from = std::max<std::int64_t>(0, k - before),
                     .to = k - before + t.length_ticks,
                     .cause = cause};
}

// The tick that every running channel with a message each tick has passed.
std::int64_t Recording::passed_k() const {
  std::int64_t passed = store_.last_k();
  for (const WatchedChannel& channel : channels_)
    if (ticks_every_time(channel.channel()) && channel.messages() > 0 &&
        channel.last_seq() > store_.last_k() - kSlackTicks)
      passed = std::min(passed, channel.last_seq());
  return passed;
}

// Columns of the seq of the channels that have messages in this range, but not at every tick.
std::vector<int> Recording::with_gaps(std::int64_t from, std::int64_t to) {
  std::vector<int> columns;
  for (const WatchedChannel& channel : channels_) {
    if (!ticks_every_time(channel.channel()) || channel.messages() == 0) continue;
    const int seq = signals_.of_message(channel.channel(), "", 0, 0);
    const std::int64_t count = store_.extent(seq, from, to).count;
    if (count > 0 && count < to - from) columns.push_back(seq);
  }
  return columns;
}

void Recording::complete_captures(bool standstill) {
  if (!pending_ || (!standstill && passed_k() < pending_->to - 1)) return;
  const std::int64_t from = std::max(pending_->from, store_.first_k()),
                     to = std::min(pending_->to, store_.last_k() + 1);
  const std::vector<int> columns = with_gaps(from, to);
  // A late repeat can still fill a gap.
  if (!columns.empty() && !standstill && passed_k() < to - 1 + kLateTicks) return;
  Capture capture = std::move(*pending_);
  pending_.reset();
  capture.from = from;
  capture.to = to;
  capture.ticks = store_.part(from, to);
  for (std::int64_t k = from; k < to && !columns.empty(); ++k)
    capture.missing += std::any_of(columns.begin(), columns.end(),
                                   [&](int seq) { return std::isnan(store_.at(seq, k)); });
  captures_.push_back(std::move(capture));
  if (captures_.size() > kCapturesKept) captures_.pop_front();
}

void Recording::look(std::int64_t now_us) {
  const Lock lock(mutex_);
  if (pending_ && now_us - last_arrival_us_ > kStandstill_us) complete_captures(true);
}

void Recording::note_bus(std::int64_t now_us) {
  const Lock lock(mutex_);
  std::array<std::int64_t, kChannelCount> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i) counts[i] = channels_[i].messages();
  counts_.emplace_back(now_us, counts);
  while (counts_.size() > 1 && now_us - counts_[1].first >= kRate_us) counts_.pop_front();
  if (store_.empty()) return;
  const std::int64_t k = store_.last_k();
  for (WatchedChannel& channel : channels_) {
    if (channel.messages() == 0) continue;
    const std::string base = "bus." + layout_of(channel.channel()).short_name + ".";
    const auto note = [&](const char* name, const char* unit, const char* comment, double value) {
      int column = signals_.find(base + name);
      if (column < 0) column = signals_.add({base + name, unit, comment, false});
      put(column, k, value);
    };
    if (channel.has_interval())
      note("rate_Hz", "Hz", "messages a second of wall time", channel.rate_Hz(now_us));
    note("gaps", "", "sequence numbers that did not arrive here, so far",
         static_cast<double>(channel.gaps()));
    if (const auto latency = channel.latency_us())
      note("latency_us", "us", "mean time after the MEASUREMENT of the same tick", *latency);
    channel.begin_interval(now_us);
  }
}

double Recording::rate_Hz(std::size_t channel, std::int64_t now_us) const {
  if (counts_.empty() || now_us <= counts_.front().first) return 0;
  const auto& [then_us, counts] = counts_.front();
  return 1e6 * static_cast<double>(channels_[channel].messages() - counts[channel]) /
         static_cast<double>(now_us - then_us);
}

const TickStore* Recording::store_of(int capture) const {
  if (capture == 0) return &store_;
  for (const Capture& c : captures_)
    if (c.id == capture) return &c.ticks;
  return nullptr;
}

Reduced Recording::reduce(const std::string& signal, const Span& span) const {
  const Lock lock(mutex_);
  const TickStore* store = store_of(span.capture);
  const int column = signals_.find(signal);
  Reduced reduced;
  for (std::int64_t k = span.from; k < span.to; k += span.bucket) {
    Extent e;
    if (store && column >= 0) e = store->extent(column, k, std::min(span.to, k + span.bucket));
    reduced.min.push_back(e.empty() ? kNoValue : e.min);
    reduced.max.push_back(e.empty() ? kNoValue : e.max);
  }
  return reduced;
}

std::vector<double> Recording::samples(const std::string& signal, const Span& span) const {
  const Lock lock(mutex_);
  const TickStore* store = store_of(span.capture);
  const int column = signals_.find(signal);
  std::vector<double> list;
  for (std::int64_t k = span.from; k < span.to; k += span.bucket)
    list.push_back(store && column >= 0 ? store->at(column, k) : kNoValue);
  return list;
}

Extent Recording::extent(const std::string& signal, const Span& span) const {
  const Lock lock(mutex_);
  const TickStore* store = store_of(span.capture);
  const int column = signals_.find(signal);
  return store && column >= 0 ? store->extent(column, span.from, span.to) : Extent{};
}

void Recording::set_trigger(const TriggerSettings& settings) {
  const Lock lock(mutex_);
  trigger_.set(settings);
  trigger_column_ = settings.signal.empty() ? -1 : signals_.find(settings.signal);
  pending_.reset();
}

TriggerSettings Recording::trigger() const {
  const Lock lock(mutex_);
  return trigger_.settings();
}

void Recording::force_trigger() {
  const Lock lock(mutex_);
  if (pending_ || store_.empty()) return;
  trigger_.force(store_.last_k());
  begin_capture(store_.last_k(), "forced");
}

std::int64_t Recording::first_k() const {
  const Lock lock(mutex_);
  return store_.first_k();
}

std::int64_t Recording::last_k() const {
  const Lock lock(mutex_);
  return store_.last_k();
}

std::int64_t Recording::complete_k() const {
  const Lock lock(mutex_);
  return passed_k();
}

DriveFileFacts Recording::drive() const {
  const Lock lock(mutex_);
  return drive_;
}

std::vector<Signal> Recording::signals() const {
  const Lock lock(mutex_);
  return signals_.list();
}

std::vector<ScopeEvent> Recording::event_list() const {
  const Lock lock(mutex_);
  return {events_.begin(), events_.end()};
}

void Recording::use_run_directory(const std::string& directory) {
  const Lock lock(mutex_);
  run_directory_ = directory;
}

namespace {

bool is_steered(const ScopeEvent& event) {
  return event.reason == reason_name(static_cast<int>(Reason::kSteered));
}

// The requests before tick k in the log of the session; empty if the log does not reach k yet.
std::optional<std::vector<AppliedSteering>> logged_requests(const std::string& directory,
                                                            std::int64_t session, std::int64_t k) {
  constexpr std::int64_t kMostTicks = 200'000;  // about 0.2 GB
  if (directory.empty() || k > kMostTicks) return {};
  std::vector<AppliedSteering> requests;
  try {
    EventLog log(directory, OnDamage::kSkip);
    while (const lcm::LogEvent* event = log.next()) {
      const auto size = static_cast<std::size_t>(event->datalen);
      const auto header = read_header(static_cast<const std::uint8_t*>(event->data), size);
      if (!log.channel() || !header || header->session != session) continue;
      if (log.channel() == Channel::kMeasurement && header->seq >= k) return requests;
      event_t told{};
      if (log.channel() == Channel::kEvent && decode(told, event->data, size) &&
          told.reason == static_cast<int>(Reason::kSteered))
        requests.push_back({told.seq, told.text});
    }
  } catch (const BadInput&) {  // no log there, or not yet
  }
  return {};
}

}  // namespace

std::optional<std::vector<AppliedSteering>> Recording::requests() const {
  std::unique_lock lock(mutex_);
  if (heard_from_k_ < 0 || events_before_ > 0) return {};
  std::vector<AppliedSteering> heard;
  for (const ScopeEvent& event : events_)
    if (is_steered(event)) heard.push_back({event.k, event.text});
  const std::int64_t from = heard_from_k_, session = session_;
  const std::string directory = run_directory_;
  lock.unlock();
  if (from == 0) return heard;
  std::optional<std::vector<AppliedSteering>> all = logged_requests(directory, session, from);
  if (all) all->insert(all->end(), heard.begin(), heard.end());
  return all;
}

int Recording::generation() const {
  const Lock lock(mutex_);
  return generation_;
}

std::int64_t Recording::undecodable() const {
  const Lock lock(mutex_);
  return undecodable_;
}

}  // namespace twinrate::scope

#include "export/tick_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/manifest.hpp"
#include "core/reason.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// The channel's name without DRIVE_.
std::string short_name(Channel channel) {
  return std::string(info(channel).name).substr(6);
}

template <class Wire>
Wire decoded(const std::string& path, const void* bytes, std::size_t size) {
  Wire wire{};
  if (!decode(wire, bytes, size))
    throw BadInput(fmt::format("{}: messages have another type version than this program", path));
  return wire;
}

}  // namespace

TickTable::TickTable(std::string path, std::vector<Channel> beside, Put put)
    : path_(std::move(path)), beside_(std::move(beside)), put_(std::move(put)) {}

bool TickTable::wants(Channel channel) const {
  return channel == Channel::kMeasurement || channel == Channel::kReference ||
         channel == Channel::kCommand || channel == Channel::kManifest ||
         channel == Channel::kEvent || is_beside(channel);
}

void TickTable::take_manifest(const manifest_t& manifest) {
  if (n_p_ || manifest.config_toml.empty()) return;
  Config config = Config::parse(manifest.config_toml, path_);
  n_p_ = config.drive().machine.n_p;
  imported_ = imported_signals(manifest.manifest_json);
  if (!imported_) load_.emplace(config.drive());
}

void TickTable::take_event(const event_t& event) {
  if (load_ && event.reason == static_cast<int>(Reason::kSteered))
    load_->steer(event.seq, event.text);
}

bool TickTable::is_beside(Channel channel) const {
  return std::find(beside_.begin(), beside_.end(), channel) != beside_.end();
}

bool TickTable::may_have(const char* signal) const {
  return !imported_ || std::find(imported_->begin(), imported_->end(), signal) != imported_->end();
}

void TickTable::take(Channel channel, const void* bytes, std::size_t size) {
  if (channel == Channel::kManifest) return take_manifest(decoded<manifest_t>(path_, bytes, size));
  event_t event{};
  if (channel == Channel::kEvent && decode(event, bytes, size)) take_event(event);
  if (channel == Channel::kEvent && !is_beside(channel)) return;
  Sample sample;
  Layout layout;
  if (!read_sample(channel, bytes, size, sample, layouts_.count(channel) ? nullptr : &layout))
    throw BadInput(fmt::format("{}: messages have another type version than this program", path_));
  if (sample.k <= last_k_) {
    ++late_;
    return;
  }
  Tick& tick = ticks_[sample.k];
  if (channel == Channel::kMeasurement && !tick.measurement)
    tick.measurement = from_wire(decoded<measurement_t>(path_, bytes, size));
  if (channel == Channel::kReference && !tick.reference)
    tick.reference = from_wire(decoded<reference_t>(path_, bytes, size));
  if (channel == Channel::kCommand && !tick.command)
    tick.command = from_wire(decoded<command_t>(path_, bytes, size));
  if (is_beside(channel)) {
    layouts_.try_emplace(channel, std::move(layout));
    tick.beside.try_emplace(channel, std::move(sample));
  }
  while (ticks_.size() > kMaxLateTicks && put_first(false)) {
  }
}

void TickTable::finish() {
  while (!ticks_.empty() && put_first(true)) {
  }
}

bool TickTable::put_first(bool at_end) {
  const auto first = ticks_.begin();
  if (!chosen_) choose_columns();
  const auto following = std::find_if(std::next(first), ticks_.end(), [](const auto& tick) {
    return tick.second.measurement.has_value();
  });
  if (following == ticks_.end() && !at_end) return false;
  const Measurement* behind = following == ticks_.end() ? nullptr : &*following->second.measurement;
  const int needed = signals_ & ~kVoltage;
  const auto& m = first->second.measurement;
  if (m && load_) T_load_ = load_->at(1e-9 * static_cast<double>(m->t_ns));
  if (m && (m->signals & needed) == needed && (behind || !(signals_ & kVoltage)))
    put_row(first->second, behind);
  else if (behind)
    ++left_out_;
  last_k_ = first->first;
  ticks_.erase(first);
  return true;
}

void TickTable::add_columns(std::initializer_list<const char*> names, FieldKind kind) {
  for (const char* name : names) layout_.numbers.push_back({.name = name, .kind = kind});
}

void TickTable::choose_columns() {
  chosen_ = true;
  for (const auto& [k, tick] : ticks_) {
    if (tick.measurement) signals_ |= tick.measurement->signals;
    i_dq_ref_ = i_dq_ref_ || tick.command;
    omega_m_ref_ = omega_m_ref_ || (tick.reference && may_have("speed reference"));
    i_d_ref_ = i_d_ref_ || (tick.reference && may_have("i_d reference"));
  }
  i_d_ref_ = i_d_ref_ && !i_dq_ref_;
  if (!n_p_) signals_ &= ~kQCurrentOnly;  // i_q needs n_p

  duty_ = (signals_ & kVoltage) && may_have("duty");
  const auto linear = FieldKind::kLinear;
  if (signals_ & kQCurrentOnly)
    add_columns({"i_q"}, linear);
  else if (signals_ & kPhaseCurrents)
    add_columns({"i_a", "i_b", "i_c"}, linear);
  if (signals_ & kVoltage) add_columns({"u_alpha", "u_beta"}, FieldKind::kMean);
  if (duty_) add_columns({"duty_a", "duty_b", "duty_c"}, FieldKind::kMean);
  if (signals_ & kBusVoltage) add_columns({"v_dc"}, linear);
  if (signals_ & kPosition) add_columns({"theta_m"}, linear);
  if (signals_ & kSpeed) add_columns({"omega_m"}, linear);
  if (load_) add_columns({"T_load"}, linear);
  if (omega_m_ref_) add_columns({"omega_m_ref"}, linear);
  if (i_dq_ref_) add_columns({"i_d_ref", "i_q_ref"}, linear);
  if (i_d_ref_) add_columns({"i_d_ref"}, linear);
  for (const Channel channel : beside_) {
    const auto found = layouts_.find(channel);
    if (found == layouts_.end())
      throw BadInput(fmt::format("{}: no {} in the log's first ticks", path_, info(channel).name));
    for (const Field& f : found->second.numbers)
      for (std::size_t i = 0; i < f.count; ++i)
        layout_.numbers.push_back(
            {.name = short_name(channel) + "." + f.name + (f.array ? fmt::format("_{}", i) : ""),
             .kind = f.kind,
             .whole = f.whole});
  }
  put_.header(layout_);
}

void TickTable::put_row(const Tick& tick, const Measurement* behind) {
  Sample row{.k = tick.measurement->k, .t_ns = tick.measurement->t_ns};
  put_canonical(tick, behind, row);
  for (const Channel channel : beside_) put_beside(tick, channel, row);
  row.counts.assign(row.numbers.size(), 1);
  put_.row(row);
}

// A value that the log lacks at this tick is that of the tick before.
void TickTable::put_canonical(const Tick& tick, const Measurement* behind, Sample& row) {
  const Measurement& m = *tick.measurement;
  std::vector<double>& x = row.numbers;
  if (signals_ & kQCurrentOnly)
    x.push_back(park(clarke(m.i_abc), *n_p_ * m.theta_m)[1]);
  else if (signals_ & kPhaseCurrents)
    x.insert(x.end(), {m.i_abc[0], m.i_abc[1], m.i_abc[2]});
  if (signals_ & kVoltage) x.insert(x.end(), {behind->u_alphabeta[0], behind->u_alphabeta[1]});
  if (duty_) x.insert(x.end(), behind->duty_abc.data(), behind->duty_abc.data() + 3);
  if (signals_ & kBusVoltage) x.push_back(m.v_dc);
  if (signals_ & kPosition) x.push_back(m.theta_m);
  if (signals_ & kSpeed) x.push_back(m.omega_m);
  if (load_) x.push_back(T_load_);
  if (omega_m_ref_) x.push_back(tick.reference ? tick.reference->omega_m_ref : kNone);
  if (i_dq_ref_) {
    x.push_back(tick.command ? tick.command->i_dq_ref[0] : kNone);
    x.push_back(tick.command ? tick.command->i_dq_ref[1] : kNone);
  }
  if (i_d_ref_) x.push_back(tick.reference ? tick.reference->i_d_ref : kNone);
  canonical_.resize(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    if (std::isnan(x[i])) x[i] = canonical_[i];
  canonical_ = x;
  row.wholes.assign(x.size(), 0);
}

void TickTable::put_beside(const Tick& tick, Channel channel, Sample& row) const {
  const auto found = tick.beside.find(channel);
  const std::vector<Field>& fields = layouts_.at(channel).numbers;
  const double* number = found == tick.beside.end() ? nullptr : found->second.numbers.data();
  const std::int64_t* whole = number ? found->second.wholes.data() : nullptr;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const std::size_t there = number ? found->second.counts[f] : 0;
    for (std::size_t i = 0; i < fields[f].count; ++i) {
      row.numbers.push_back(i < there ? number[i] : kNone);
      row.wholes.push_back(i < there ? whole[i] : 0);
    }
    number += there;
    whole += there;
  }
}

}  // namespace twinrate

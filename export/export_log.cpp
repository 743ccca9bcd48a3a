#include "export/export_log.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>

#include "core/config.hpp"
#include "core/percent_line.hpp"
#include "core/run_log.hpp"
#include "drive_log/log_reader.hpp"
#include "export/resampler.hpp"
#include "export/sink.hpp"
#include "export/tick_table.hpp"
#include "import/row_reader.hpp"

namespace twinrate {
namespace {

constexpr std::int64_t kMaxDisorder_ns = 1'000'000'000;  // of the messages in a log
constexpr int kProgressEvery = 4096;

// Channels with one message a tick, and GAIN: these can be tabulated and resampled.
bool of_ticks(Channel channel) {
  return channel <= Channel::kCommand;
}

std::string short_name(Channel channel) {
  return std::string(info(channel).name).substr(6);
}

std::unique_ptr<ExportSink> make_sink(const ExportRequest& request) {
  if (request.format == "csv") return make_csv_sink(request.out);
  if (request.format == "mat") return make_mat_sink(request.out);
  return make_mcap_sink(request.out, request.compression == "none" ? "" : request.compression);
}

// Passes streams to the file, resampled if requested and cut to the requested time.
class Outlet {
 public:
  explicit Outlet(const ExportRequest& request) : request_(request), sink_(make_sink(request)) {}

  std::size_t add(const std::string& name, const Layout& layout, bool resampled) {
    const std::size_t id = streams_.size();
    streams_.push_back({.done = {.name = name}, .layout = layout});
    if (request_.rate_Hz > 0 && resampled)
      resamplers_[id] = std::make_unique<Resampler>(request_.rate_Hz, layout,
                                                    [this, id](const Sample& s) { put(id, s); });
    return id;
  }
  void take(std::size_t id, const Sample& sample) {
    const auto found = resamplers_.find(id);
    if (found != resamplers_.end())
      found->second->take(sample);
    else
      put(id, sample);
  }
  std::vector<ExportedStream> finish(const std::string& log, bool interrupted) {
    for (auto& [id, resampler] : resamplers_) resampler->finish();
    std::vector<ExportedStream> list;
    for (const Stream& s : streams_)
      if (s.done.samples > 0) list.push_back(s.done);
    if (list.empty() && interrupted) throw Stopped{};
    if (list.empty())
      throw BadInput(streams_.empty()
                         ? fmt::format("{}: holds no message of the channels asked for", log)
                     : first_ns_ > last_ns_
                         ? fmt::format("{}: the samples that --resample asks for are further apart "
                                       "than the log is long",
                                       log)
                         : fmt::format("{}: nothing between --from and --to; the log runs from "
                                       "{:.6g} to {:.6g} s",
                                       log, 1e-9 * static_cast<double>(first_ns_),
                                       1e-9 * static_cast<double>(last_ns_)));
    sink_->finish();
    return list;
  }

 private:
  struct Stream {
    ExportedStream done;
    Layout layout;
    std::size_t place = 0;  // number of the stream in the file
  };
  void put(std::size_t id, const Sample& sample) {
    first_ns_ = std::min(first_ns_, sample.t_ns);
    last_ns_ = std::max(last_ns_, sample.t_ns);
    const double t = static_cast<double>(sample.t_ns) / 1e9;
    if (t < request_.from_s || t > request_.to_s) return;
    Stream& s = streams_[id];
    if (s.done.samples++ == 0) {
      s.place = opened_++;
      s.done.first_s = t;
      sink_->open(s.done.name, s.layout);
    }
    s.done.last_s = t;
    sink_->write(s.place, sample);
  }

  const ExportRequest& request_;
  std::unique_ptr<ExportSink> sink_;
  std::vector<Stream> streams_;
  std::map<std::size_t, std::unique_ptr<Resampler>> resamplers_;
  std::size_t opened_ = 0;
  std::int64_t first_ns_ = INT64_MAX, last_ns_ = INT64_MIN;
};

std::int64_t end_of_reading(double to_s) {
  return to_s < 9e9 ? static_cast<std::int64_t>(1e9 * to_s) + kMaxDisorder_ns : INT64_MAX;
}

// t_ns of the common message header.
std::int64_t time_of(const lcm::LogEvent& event) {
  std::uint64_t t_ns = 0;
  if (event.datalen < 24) return 0;
  for (int i = 16; i < 24; ++i) t_ns = t_ns << 8 | static_cast<const std::uint8_t*>(event.data)[i];
  return static_cast<std::int64_t>(t_ns);
}

// Calls `take` with each message up to the requested end. Returns true if `progress` threw Stopped.
template <class Take>
bool each_event(EventLog& events, const ExportRequest& request,
                const std::function<void(double)>& progress, Take&& take) {
  const std::int64_t end_ns = end_of_reading(request.to_s);
  try {
    for (int n = 0; const lcm::LogEvent* event = events.next(); ++n) {
      if (!events.channel()) continue;
      if (of_ticks(*events.channel()) && time_of(*event) > end_ns) break;
      take(*events.channel(), *event);
      if (progress && n % kProgressEvery == 0) progress(events.share_read());
    }
  } catch (const Stopped&) {
    return true;
  }
  return false;
}

void expect_found(const ExportRequest& request, const std::set<Channel>& found) {
  std::vector<std::string> there;
  there.reserve(found.size());
  for (const Channel channel : found) there.push_back(short_name(channel));
  if (there.empty())
    throw BadInput(fmt::format("{}: holds no message of this project", request.log));
  for (const Channel channel : request.channels)
    if (!found.count(channel))
      throw BadInput(fmt::format("--channels: no {} in {}; it holds {}", short_name(channel),
                                 request.log, fmt::join(there, ", ")));
}

Exported export_table(const ExportRequest& request, const std::function<void(double)>& progress) {
  for (const Channel channel : request.channels)
    if (!of_ticks(channel))
      throw BadInput(fmt::format(
          "--channels: {} has no message a tick, so no column in a csv; --format mat or mcap take "
          "it",
          short_name(channel)));
  EventLog events(request.log, request.on_damage);
  Outlet outlet(request);
  std::size_t id = 0;
  TickTable table(request.log, request.channels,
                  {.header = [&](const Layout& l) { id = outlet.add("DRIVE_LOG", l, true); },
                   .row = [&](const Sample& row) { outlet.take(id, row); }});
  Exported result;
  result.interrupted =
      each_event(events, request, progress, [&](Channel channel, const lcm::LogEvent& event) {
        if (table.wants(channel))
          table.take(channel, event.data, static_cast<std::size_t>(event.datalen));
      });
  table.finish();
  result.left_out = table.left_out();
  result.late = table.late();
  result.damage = events.damage();
  result.streams = outlet.finish(request.log, result.interrupted);
  return result;
}

Exported export_channels(const ExportRequest& request,
                         const std::function<void(double)>& progress) {
  EventLog events(request.log, request.on_damage);
  Outlet outlet(request);
  std::map<Channel, std::size_t> ids;
  std::set<Channel> found;
  Sample sample;
  Layout layout;
  std::int64_t number = 0;
  const auto asked = [&](Channel channel) {
    if (request.channels.empty()) return channel != Channel::kAck;
    return std::find(request.channels.begin(), request.channels.end(), channel) !=
           request.channels.end();
  };
  Exported result;
  result.interrupted =
      each_event(events, request, progress, [&](Channel channel, const lcm::LogEvent& event) {
        found.insert(channel);
        if (!asked(channel)) return;
        const bool known = ids.count(channel) != 0;
        if (!read_sample(channel, event.data, static_cast<std::size_t>(event.datalen), sample,
                         known ? nullptr : &layout))
          throw BadInput(
              fmt::format("{}: messages have another type version than this program", request.log));
        sample.origin.timestamp_us = event.timestamp;
        sample.origin.event = number++;
        if (!known) ids[channel] = outlet.add(short_name(channel), layout, of_ticks(channel));
        outlet.take(ids[channel], sample);
      });
  result.damage = events.damage();
  if (!result.interrupted) expect_found(request, found);
  result.streams = outlet.finish(request.log, result.interrupted);
  return result;
}

FieldKind kind_of_column(const std::string& name) {
  if (name.starts_with("u_") || name.starts_with("duty_")) return FieldKind::kMean;
  return name == "theta_m" ? FieldKind::kAngle : FieldKind::kLinear;
}

Exported export_drive_log(const ExportRequest& request,
                          const std::function<void(double)>& progress) {
  if (!request.channels.empty())
    throw BadInput(fmt::format("--channels: {} is no LCM log", request.log));
  RowReader rows(request.log, nullptr, false);
  Layout layout;
  std::vector<std::size_t> column;  // of each field
  for (const std::string& name : canonical_columns()) {
    const auto found = std::find(rows.names().begin(), rows.names().end(), name);
    if (found == rows.names().end()) continue;
    column.push_back(static_cast<std::size_t>(found - rows.names().begin()));
    layout.numbers.push_back({.name = name, .kind = kind_of_column(name)});
  }
  Outlet outlet(request);
  const std::size_t id = outlet.add("DRIVE_LOG", layout, true);
  Exported result;
  const std::int64_t end_ns = end_of_reading(request.to_s);
  try {
    Sample row;
    row.counts.assign(column.size(), 1);
    for (std::int64_t k = 0; rows.next(); ++k) {
      row.k = k;
      row.t_ns = std::llround(1e9 * rows.t());
      row.numbers.clear();
      for (std::size_t c : column) row.numbers.push_back(rows.values()[c]);
      if (row.t_ns > end_ns) break;
      outlet.take(id, row);
      if (progress && k % kProgressEvery == 0) progress(rows.share_read());
    }
  } catch (const Stopped&) {
    result.interrupted = true;
  }
  result.streams = outlet.finish(request.log, result.interrupted);
  return result;
}

}  // namespace

Exported export_log(const ExportRequest& request, const std::function<void(double)>& progress) {
  if (!is_run_log(request.log)) return export_drive_log(request, progress);
  return request.format == "csv" ? export_table(request, progress)
                                 : export_channels(request, progress);
}

std::vector<Channel> channels_of(const std::string& list) {
  std::vector<Channel> channels;
  std::stringstream in(list);
  for (std::string name; std::getline(in, name, ',');) {
    const auto found = std::find_if(kChannels.begin(), kChannels.end(), [&](const auto& c) {
      return c.name == name || std::string(c.name).substr(6) == name;
    });
    if (found == kChannels.end()) {
      std::vector<std::string> known;
      known.reserve(kChannels.size());
      for (const ChannelInfo& c : kChannels) known.push_back(short_name(c.channel));
      throw BadInput(fmt::format("--channels {}: no such channel; there are {}", name,
                                 fmt::join(known, ", ")));
    }
    if (std::find(channels.begin(), channels.end(), found->channel) == channels.end())
      channels.push_back(found->channel);
  }
  return channels;
}

}  // namespace twinrate

#include "scope/api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "scope/request_body.hpp"
#include "scope/tick_csv.hpp"

namespace twinrate::scope {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::int64_t kMostValues = 4'000'000;  // of one answer: 32 MB
constexpr std::int64_t kMostBuckets = 4096;      // of one frame and signal
constexpr double kHolderGone_s = 3;
constexpr std::size_t kMostSignals = 64;
constexpr std::int64_t kMostCsvTicks = 2'000'000;

void expect_csv(const Span& span) {
  if (span.to - span.from > kMostCsvTicks)
    throw BadInput(fmt::format("{} ticks as CSV allowed", kMostCsvTicks));
}

std::int64_t now_us() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

std::string text_of(const Query& query, const std::string& key) {
  const auto found = query.parameters.find(key);
  return found == query.parameters.end() ? "" : found->second;
}

std::int64_t whole_of(const Query& query, const std::string& key, std::int64_t fallback) {
  const std::string text = text_of(query, key);
  if (text.empty()) return fallback;
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() ||
      std::abs(value) > 1'000'000'000'000)
    throw BadInput(fmt::format("{}: a whole number allowed", key));
  return value;
}

std::vector<std::string> names_of(const std::string& text) {
  std::vector<std::string> names;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    if (end > at) names.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  if (names.size() > kMostSignals)
    throw BadInput(fmt::format("signals: {} allowed at a time", kMostSignals));
  return names;
}

Answer json_answer(const Json& json) {
  return {.body = json.dump(-1, ' ', false, Json::error_handler_t::replace)};
}

void append(std::string& body, const std::vector<double>& values) {
  const std::size_t at = body.size();
  body.resize(at + 8 * values.size());
  std::memcpy(body.data() + at, values.data(), 8 * values.size());
}

Json replies_json(const Steering::Replies& replies) {
  Json list = Json::array();
  for (const SteeringReply& r : replies)
    list.push_back(
        {{"role", r.role}, {"accepted", r.accepted}, {"applied_k", r.applied_k}, {"text", r.text}});
  return {{"replies", list}};
}

// A ghost is compared with the drive tick by tick, so both need the same rate. 0: not known yet.
void expect_same_rate(double T_s, double T_s_of_ghost) {
  if (T_s > 0 && T_s_of_ghost > 0 && std::abs(T_s_of_ghost / T_s - 1) > 1e-6)
    throw BadInput(fmt::format("the ghost has f_s = {:g} Hz, the drive {:g} Hz: the same allowed",
                               1 / T_s_of_ghost, 1 / T_s));
}

}  // namespace

struct Api::Reader {
  std::shared_ptr<Recording> recording;
  std::vector<std::string> signals;
  Span span;
  std::int64_t count() const { return (span.to - span.from + span.bucket - 1) / span.bucket; }
};

Api::Api(Sources& sources, LiveDrive* live, std::string title, Traces& traces)
    : sources_(sources), live_(live), title_(std::move(title)), traces_(traces) {}

Api::Reader Api::read(const Query& query, std::int64_t most_values) {
  Reader reader;
  reader.recording = sources_.find(text_of(query, "source"));
  if (!reader.recording) throw BadInput("source: no such run");
  reader.signals = names_of(text_of(query, "signals"));
  reader.span.capture = static_cast<int>(whole_of(query, "capture", 0));
  reader.span.from = whole_of(query, "from", 0);
  reader.span.to = whole_of(query, "to", reader.recording->last_k() + 1);
  reader.span.bucket = whole_of(query, "bucket", 1);
  if (reader.span.bucket < 1) throw BadInput("bucket: 1 or more ticks allowed");
  if (reader.span.to < reader.span.from) throw BadInput("to: not before from allowed");
  const auto signals = static_cast<std::int64_t>(std::max<std::size_t>(1, reader.signals.size()));
  if (reader.count() * signals > most_values)
    throw BadInput(fmt::format("{} values asked for, {} allowed: a larger bucket or fewer ticks",
                               reader.count() * signals, most_values));
  return reader;
}

Answer Api::answer(const Query& query) {
  try {
    if (query.post) {
      const Json body = Json::parse(query.body, nullptr, false);
      if (!body.is_object()) throw BadInput("a JSON object allowed");
      if (query.path == "/api/trigger") return set_trigger(body);
      if (query.path == "/api/control") return control(body);
      if (query.path == "/api/request") return request(body);
      if (query.path == "/api/trace") return trace(body);
    } else {
      if (query.path == "/api/info") return info();
      if (query.path == "/api/tree") return json_answer(sources_.drive().tree(now_us()));
      if (query.path == "/api/events") {
        const auto recording = sources_.find(text_of(query, "source"));
        if (!recording) throw BadInput("source: no such run");
        return json_answer(recording->events(static_cast<std::size_t>(whole_of(query, "from", 0))));
      }
      if (query.path == "/api/data") return data(query);
      if (query.path == "/api/samples") return samples(query);
      if (query.path == "/api/statistics") return statistics(query);
      if (query.path == "/api/csv") return csv(query);
      if (query.path == "/api/align") return align(query);
      if (query.path == "/trace")
        return {.type = "text/html; charset=utf-8",
                .body = traces_.page(static_cast<int>(whole_of(query, "id", 0)))};
    }
    return {.status = 404, .type = "text/plain", .body = "no such page\n"};
  } catch (const BadInput& error) {
    return {.status = 400, .type = "text/plain", .body = std::string(error.what()) + "\n"};
  }
}

Json Api::live_state() const {
  if (!live_) return nullptr;
  return {{"url", live_->url()},
          {"session", fmt::format("{:x}", live_->session())},
          {"heard", live_->heard()},
          {"silent_s", live_->silent_s()}};
}

Answer Api::info() {
  return json_answer({{"title", title_},
                      {"live", live_state()},
                      {"runs", sources_.runs()},
                      {"brief", sources_.drive().brief()}});
}

Answer Api::data(const Query& query) {
  const Reader reader = read(query, kMostValues);
  Answer answer{.type = "application/octet-stream"};
  for (const std::string& signal : reader.signals) {
    const Reduced reduced = reader.recording->reduce(signal, reader.span);
    append(answer.body, reduced.min);
    append(answer.body, reduced.max);
  }
  return answer;
}

Answer Api::samples(const Query& query) {
  const Reader reader = read(query, kMostValues);
  Answer answer{.type = "application/octet-stream"};
  for (const std::string& signal : reader.signals)
    append(answer.body, reader.recording->samples(signal, reader.span));
  return answer;
}

Answer Api::statistics(const Query& query) {
  const Reader reader = read(query, INT64_MAX / 1024);
  Json list = Json::array();
  for (const std::string& signal : reader.signals) {
    const Extent e = reader.recording->extent(signal, reader.span);
    const double n = static_cast<double>(e.count);
    list.push_back({{"signal", signal},
                    {"count", e.count},
                    {"min", number(e.min)},
                    {"max", number(e.max)},
                    {"mean", e.empty() ? Json(nullptr) : number(e.sum / n)},
                    {"rms", e.empty() ? Json(nullptr) : number(std::sqrt(e.sum_of_squares / n))},
                    {"peak_to_peak", number(e.max - e.min)}});
  }
  return json_answer(list);
}

Answer Api::csv(const Query& query) {
  Reader reader = read(query, kMostCsvTicks * 16);
  expect_csv(reader.span);
  if (text_of(query, "trace") == "1")
    return {.type = "text/csv",
            .body = drive_log_csv(*reader.recording, reader.span),
            .file_name = "scope-drive-log.csv"};
  return {.type = "text/csv",
          .body = ticks_csv(*reader.recording, reader.signals, reader.span),
          .file_name = "scope.csv"};
}

// Writes the ticks of the range as a drive log and traces it with the drive file of the recording.
Answer Api::trace(const Json& body) {
  Query query;
  for (const char* key : {"from", "to", "capture"})
    if (body.contains(key)) query.parameters[key] = body[key].dump();
  const Reader reader = read(query, INT64_MAX / 1024);
  expect_csv(reader.span);
  const DriveFileFacts drive = reader.recording->drive();
  if (drive.config_toml.empty()) throw BadInput("trace: the drive file is not known");
  const double T_s = drive.T_s;
  const std::string what =
      fmt::format("{}, {:.4g} to {:.4g} s", drive.name, static_cast<double>(reader.span.from) * T_s,
                  static_cast<double>(reader.span.to) * T_s);
  const int id =
      traces_.start(drive.config_toml, drive_log_csv(*reader.recording, reader.span), what);
  return json_answer({{"trace", id}, {"directory", traces_.state(id)->directory}});
}

// The first tick of a run at which this trigger fires; -1 if none.
std::int64_t Api::first_trigger(const Recording& run, TriggerSettings settings) {
  settings.mode = TriggerMode::kSingle;
  Trigger trigger;
  trigger.set(settings);
  for (const ScopeEvent& e : run.event_list())
    if (trigger.event(e.k, e.reason, e.trip)) return e.k;
  constexpr std::int64_t kPiece = 100'000;
  if (!settings.signal.empty())
    for (std::int64_t from = run.first_k(); from <= run.last_k(); from += kPiece) {
      const Span piece{from, std::min(from + kPiece, run.last_k() + 1), 1, 0};
      std::int64_t k = from;
      for (const double value : run.samples(settings.signal, piece))
        if (trigger.sample(k++, value)) return k - 1;
    }
  return -1;
}

// Searches from `shift` on, over less than one turn, the tick at which the ghost's angle is that of
// tick k.
static std::int64_t shift_by_angle(Recording& drive, Recording& ghost, std::int64_t k,
                                   std::int64_t shift) {
  std::int64_t found = shift;
  const char* const angle = "measurement.theta_m_rad";
  const auto at = [](Recording& r, const char* signal, std::int64_t tick) {
    return r.samples(signal, {tick, tick + 1, 1, 0}).front();
  };
  const double wanted = at(drive, angle, k);
  const std::int64_t from = k + shift, most = 200'000;
  const std::vector<double> angles = ghost.samples(angle, {from, from + most, 1, 0});
  double best = M_PI, step = 0;  // step: the largest of a tick
  for (std::size_t i = 0; i < angles.size() && !std::isnan(angles[i]); ++i) {
    if (std::abs(angles[i] - angles[0]) > 2 * M_PI) break;
    if (i > 0) step = std::max(step, std::abs(angles[i] - angles[i - 1]));
    const double off = std::abs(std::remainder(angles[i] - wanted, 2 * M_PI));
    if (!(off < best)) continue;
    best = off;
    found = from + static_cast<std::int64_t>(i) - k;
  }
  if (!(best <= std::max(step, 1e-3)))
    throw BadInput("the ghost does not come to that angle within a turn from there on");
  return found;
}

// Tick of the ghost that corresponds to tick 0 of the drive. by = start: first ticks; event: first
// trip, else the first event of the same name `reason`; trigger: the first tick at which the
// trigger of the page fires in the ghost, on tick k of the drive; angle: the first tick of `start`
// plus less than a turn, up to the tick at which the measured angle is that of tick k of the drive.
Answer Api::align(const Query& query) {
  const auto ghost = sources_.find(text_of(query, "ghost"));
  if (!ghost) throw BadInput("ghost: no such run");
  Recording& drive = sources_.drive();
  expect_same_rate(drive.drive().T_s, ghost->drive().T_s);
  const std::string by = text_of(query, "by"), reason = text_of(query, "reason");
  const std::int64_t k = whole_of(query, "k", drive.last_k());
  std::int64_t shift = ghost->first_k() - drive.first_k();
  if (drive.brief()["generation"] != 0 || live_) shift = ghost->first_k();
  if (by == "event") {
    std::int64_t at = -1;
    for (const ScopeEvent& e : ghost->event_list())
      if (at < 0 && (reason.empty() ? e.trip : e.reason == reason)) at = e.k;
    if (at < 0) throw BadInput("the ghost has no such event");
    shift = at - k;
  } else if (by == "trigger") {
    const std::int64_t at = first_trigger(*ghost, drive.trigger());
    if (at < 0) throw BadInput("the trigger does not fire in the ghost");
    shift = at - k;
  } else if (by == "angle") {
    shift = shift_by_angle(drive, *ghost, k, shift);
  } else if (by != "start" && !by.empty()) {
    throw BadInput("by: start, event, trigger or angle allowed");
  }
  return json_answer(
      {{"shift_ticks", shift}, {"first_k", ghost->first_k()}, {"last_k", ghost->last_k()}});
}

Answer Api::set_trigger(const Json& body) {
  if (body.value("force", false))
    sources_.drive().force_trigger();
  else
    sources_.drive().set_trigger(trigger_settings(body));
  return json_answer(sources_.drive().brief()["trigger"]);
}

// At most one page has the control, and another program can have it instead.
Answer Api::control(const Json& body) {
  if (!live_) throw BadInput("a log cannot be steered");
  const std::string client = text_in(body, "client");
  if (client.empty() || client.size() > 64) throw BadInput("client: 1 to 64 characters allowed");
  const bool take = body.value("take", false);
  const auto refused = [](const std::string& why) {
    return Answer{.status = 409, .type = "text/plain", .body = why + "\n"};
  };
  {
    const std::lock_guard lock(mutex_);
    expire_holder();
    if (take && !holder_.empty() && holder_ != client)
      return refused("another page has the control");
    if (!take && holder_ != client) return json_answer({{"holder", holder_}});
    if (!take) holder_.clear();
  }
  if (take)
    for (const SteeringReply& reply : live_->take_control())
      if (!reply.accepted) return refused(reply.text);
  if (!take) live_->give_control();
  const std::lock_guard lock(mutex_);
  if (take && !holder_.empty() && holder_ != client) return refused("another page has the control");
  if (take) holder_ = client, holder_seen_s_ = 1e-6 * static_cast<double>(now_us());
  return json_answer({{"holder", holder_}});
}

// Stop and emergency stop need no control.
Answer Api::request(const Json& body) {
  if (!live_) throw BadInput("a log cannot be steered");
  const std::string kind = text_in(body, "kind"), client = text_in(body, "client");
  if (kind != "stop" && kind != "emergency_stop") {
    const std::lock_guard lock(mutex_);
    expire_holder();
    if (client.empty() || holder_ != client)
      return {.status = 409, .type = "text/plain", .body = "take control first\n"};
  }
  return json_answer(replies_json(send(kind, text_in(body, "text"))));
}

Steering::Replies Api::send(const std::string& kind, const std::string& text) {
  if (kind == "steer") return live_->steer(text);
  if (kind == "start") return live_->start();
  if (kind == "stop") return live_->stop();
  if (kind == "emergency_stop") return live_->emergency_stop();
  if (kind == "reset") return live_->reset();
  if (kind == "add_proposed") return live_->add_proposed();
  if (kind != "add_effects" && kind != "remove_effects")
    throw BadInput(
        "kind: steer, start, stop, emergency_stop, reset, add_proposed, add_effects or "
        "remove_effects "
        "allowed");
  Config::check_addition(text, "the page");
  return kind == "add_effects" ? live_->add_effects(text) : live_->remove_effects(text);
}

Api::Stream Api::open_stream(const Query& query) {
  Stream stream;
  stream.signals = names_of(text_of(query, "signals"));
  stream.bucket = whole_of(query, "bucket", 1);
  if (stream.bucket < 1) throw BadInput("bucket: 1 or more ticks allowed");
  stream.next = whole_of(query, "from", -1);
  stream.events = static_cast<std::size_t>(whole_of(query, "events", 0));
  stream.client = text_of(query, "client");
  stream.generation = sources_.drive().generation();
  return stream;
}

// Adds the buckets up to `end` that the page does not have yet. Their begins are multiples of their
// length.
void Api::add_series(Stream& stream, std::int64_t end, Json& frame) {
  Recording& drive = sources_.drive();
  std::int64_t begin = stream.next < 0 ? end : stream.next / stream.bucket * stream.bucket;
  begin = std::max(begin, end - kMostBuckets * stream.bucket);
  frame["bucket"] = stream.bucket;
  frame["begin"] = begin;
  frame["end"] = end;
  Json series = Json::array();
  if (end > begin)
    for (const std::string& signal : stream.signals) {
      const Reduced reduced = drive.reduce(signal, {begin, end, stream.bucket, 0});
      Json min = Json::array(), max = Json::array();
      for (const double value : reduced.min) min.push_back(number(value));
      if (stream.bucket > 1)
        for (const double value : reduced.max) max.push_back(number(value));
      series.push_back({min, max});
    }
  frame["series"] = series;
  stream.next = std::max(end, begin);
  add_tail(stream, end, frame);
}

// Adds the incomplete last bucket, so that a page with long buckets also moves with the drive.
void Api::add_tail(const Stream& stream, std::int64_t end, Json& frame) {
  Recording& drive = sources_.drive();
  const std::int64_t reached = drive.complete_k() + 1;
  if (stream.bucket <= 1 || reached <= end || stream.signals.empty()) return;
  Json tail = Json::array();
  for (const std::string& signal : stream.signals) {
    const Reduced reduced = drive.reduce(signal, {end, reached, stream.bucket, 0});
    tail.push_back({number(reduced.min.front()), number(reduced.max.front())});
  }
  frame["tail_end"] = reached;
  frame["tail"] = tail;
}

std::string Api::frame(Stream& stream) {
  Recording& drive = sources_.drive();
  const int generation = drive.generation();
  if (generation != stream.generation) {
    stream.generation = generation;
    stream.next = -1;
    stream.events = 0;
  }
  Json frame = drive.brief();
  frame["live"] = live_state();
  {
    const std::lock_guard lock(mutex_);
    expire_holder();
    if (!holder_.empty() && holder_ == stream.client) {
      holder_seen_s_ = 1e-6 * static_cast<double>(now_us());
      if (live_) live_->beat();
    }
    frame["holder"] = holder_;
    frame["other_holder"] = live_ && live_->holder() != live_->name() ? live_->holder() : "";
  }
  const std::int64_t end = (drive.complete_k() + 1) / stream.bucket * stream.bucket;
  add_series(stream, end, frame);
  const std::size_t events = frame["events"].get<std::size_t>();
  if (events > stream.events) frame["new_events"] = drive.events(stream.events);
  stream.events = events;
  return frame.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// A page loses the control if its stream is gone for kHolderGone_s (a page closes its stream and
// opens another one whenever its signals change), if the drive gave the control away, or if the
// drive ended.
void Api::expire_holder() {
  const bool gone = 1e-6 * static_cast<double>(now_us()) - holder_seen_s_ > kHolderGone_s;
  if (gone || !live_ || live_->holder() != live_->name()) holder_.clear();
}

}  // namespace twinrate::scope

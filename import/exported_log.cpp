#include "import/exported_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "core/config.hpp"
#include "core/message_check.hpp"
#include "core/message_fields.hpp"
#include "import/mat_file.hpp"
#include "import/mcap_file.hpp"
#include "import/mcap_format.hpp"
#include "import/whole_log.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::json;

struct WrongMessage {
  std::string what;
};

std::string short_name(const ChannelInfo& channel) {
  return std::string(channel.name).substr(6);
}

// One message in a file, by the names of its fields.
class FieldSource {
 public:
  virtual ~FieldSource() = default;
  virtual double number(const char* name) const = 0;
  virtual std::int64_t whole(const char* name) const = 0;
  virtual std::string text(const char* name) const = 0;
  // Throw if there are fewer than `count`.
  virtual std::vector<double> numbers(const char* name, std::size_t count) const = 0;
  virtual std::vector<std::int64_t> wholes(const char* name, std::size_t count) const = 0;
};

// Visitor of each_field(): sets the fields.
class Filler {
 public:
  explicit Filler(const FieldSource& source) : source_(source) {}
  void operator()(const char* name, double& value) const { value = source_.number(name); }
  void operator()(const char* name, std::int64_t& value) const { value = source_.whole(name); }
  void operator()(const char* name, std::int32_t& value) const {
    value = narrow(name, source_.whole(name));
  }
  void operator()(const char* name, std::string& text) const { text = source_.text(name); }
  void operator()(const char* name, std::vector<double>& values, std::int32_t used) const {
    constexpr std::int32_t kMaxLength = 1 << 20;  // sizes_fit() of core/decode.hpp is stricter
    if (used < 0 || used > kMaxLength)
      throw WrongMessage{fmt::format("{} has the length {}", name, used)};
    values = source_.numbers(name, static_cast<std::size_t>(used));
  }
  template <class Whole, std::size_t N>
  void operator()(const char* name, Whole (&values)[N]) const {
    const std::vector<std::int64_t> all = source_.wholes(name, N);
    for (std::size_t i = 0; i < N; ++i)
      if constexpr (sizeof(Whole) == sizeof(std::int32_t))
        values[i] = narrow(name, all[i]);
      else
        values[i] = all[i];
  }

 private:
  static std::int32_t narrow(const char* name, std::int64_t value) {
    if (value < std::numeric_limits<std::int32_t>::min() ||
        value > std::numeric_limits<std::int32_t>::max())
      throw WrongMessage{fmt::format("{} = {} is no int32_t", name, value)};
    return static_cast<std::int32_t>(value);
  }
  const FieldSource& source_;
};

class JsonSource final : public FieldSource {
 public:
  explicit JsonSource(const Json& json) : json_(json) {}
  double number(const char* name) const override { return number_of(name, member(name)); }
  std::int64_t whole(const char* name) const override { return whole_of(name, member(name)); }
  std::string text(const char* name) const override {
    const Json& value = member(name);
    if (!value.is_string()) throw WrongMessage{fmt::format("{} is no text", name)};
    return value.get<std::string>();
  }
  std::vector<double> numbers(const char* name, std::size_t count) const override {
    std::vector<double> values;
    for (const Json& value : array(name, count)) values.push_back(number_of(name, value));
    return values;
  }
  std::vector<std::int64_t> wholes(const char* name, std::size_t count) const override {
    std::vector<std::int64_t> values;
    for (const Json& value : array(name, count)) values.push_back(whole_of(name, value));
    return values;
  }

 private:
  const Json& member(const char* name) const {
    const auto found = json_.find(name);
    if (found == json_.end()) throw WrongMessage{fmt::format("{} is missing", name)};
    return *found;
  }
  const Json& array(const char* name, std::size_t count) const {
    const Json& value = member(name);
    if (!value.is_array() || value.size() != count)
      throw WrongMessage{fmt::format("{} is no array of {}", name, count)};
    return value;
  }
  static double number_of(const char* name, const Json& value) {
    if (value.is_null()) return std::numeric_limits<double>::quiet_NaN();
    if (!value.is_number()) throw WrongMessage{fmt::format("{} is no number", name)};
    return value.get<double>();
  }
  static std::int64_t whole_of(const char* name, const Json& value) {
    const bool fits = value.is_number_integer() &&
                      (!value.is_number_unsigned() ||
                       value.get<std::uint64_t>() <=
                           static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max()));
    if (!fits) throw WrongMessage{fmt::format("{} is no whole number of 64 bits", name)};
    return value.get<std::int64_t>();
  }
  const Json& json_;
};

// A row of a stream in a MATLAB file.
class MatSource final : public FieldSource {
 public:
  MatSource(const MatVariable& stream, std::size_t row) : row_(row) {
    for (const MatVariable& field : stream.parts) fields_[field.name] = &field;
  }
  void go_to(std::size_t row) { row_ = row; }
  double number(const char* name) const override { return numbers_of(name, 1).numbers[row_]; }
  std::int64_t whole(const char* name) const override {
    return whole_at(name, numbers_of(name, 1), row_);
  }
  std::string text(const char* name) const override {
    const MatVariable& cells = field(name);
    if (cells.kind != MatVariable::Kind::kCells || row_ >= cells.parts.size() ||
        cells.parts[row_].kind != MatVariable::Kind::kText)
      throw WrongMessage{fmt::format("{} is no text", name)};
    return cells.parts[row_].text;
  }
  std::vector<double> numbers(const char* name, std::size_t count) const override {
    std::vector<double> values;
    if (count == 0) return values;
    const MatVariable& matrix = numbers_of(name, count);
    for (std::size_t c = 0; c < count; ++c)
      values.push_back(matrix.numbers[c * matrix.rows + row_]);
    return values;
  }
  std::vector<std::int64_t> wholes(const char* name, std::size_t count) const override {
    std::vector<std::int64_t> values;
    const MatVariable& matrix = numbers_of(name, count);
    for (std::size_t c = 0; c < count; ++c)
      values.push_back(whole_at(name, matrix, c * matrix.rows + row_));
    return values;
  }

 private:
  const MatVariable& field(const char* name) const {
    const auto found = fields_.find(name);
    if (found == fields_.end()) throw WrongMessage{fmt::format("{} is missing", name)};
    return *found->second;
  }
  const MatVariable& numbers_of(const char* name, std::size_t columns) const {
    const MatVariable& matrix = field(name);
    if (matrix.kind != MatVariable::Kind::kNumbers || row_ >= matrix.rows ||
        columns > matrix.columns)
      throw WrongMessage{fmt::format("{} has no {} numbers in row {}", name, columns, row_ + 1)};
    return matrix;
  }
  static std::int64_t whole_at(const char* name, const MatVariable& matrix, std::size_t at) {
    if (!matrix.wholes.empty()) return matrix.wholes[at];
    const double value = matrix.numbers[at];
    if (!(std::abs(value) <= 9007199254740992.0) || value != std::floor(value))
      throw WrongMessage{fmt::format("{} = {} is no whole number", name, value)};
    return static_cast<std::int64_t>(value);
  }
  std::map<std::string, const MatVariable*> fields_;
  std::size_t row_;
};

// Writes messages to the log.
class LogFiller {
 public:
  explicit LogFiller(const std::string& out) : log_(out) {}

  void put(const ChannelInfo& channel, const FieldSource& source) {
    switch (channel.channel) {
      case Channel::kMeasurement:
        return put_as<measurement_t>(source);
      case Channel::kTruth:
        return put_as<truth_t>(source);
      case Channel::kEstimate:
        return put_as<estimate_t>(source);
      case Channel::kGain:
        return put_as<gain_t>(source);
      case Channel::kReference:
        return put_as<reference_t>(source);
      case Channel::kCommand:
        return put_as<command_t>(source);
      case Channel::kStatus:
        return put_as<status_t>(source);
      case Channel::kEvent:
        return put_as<event_t>(source);
      case Channel::kManifest:
        return put_as<manifest_t>(source);
      case Channel::kRequest:
        return put_as<request_t>(source);
      case Channel::kReply:
        return put_as<reply_t>(source);
      case Channel::kAck:
        return put_as<ack_t>(source);
    }
  }
  std::map<std::string, std::int64_t> finish(const std::string& path) {
    if (counts_.empty())
      throw BadInput(fmt::format(
          "{}: no message of twinrate export in the file; a foreign log is read through --map",
          path));
    log_.finish();
    return counts_;
  }

 private:
  template <class Message>
  void put_as(const FieldSource& source) {
    const ChannelInfo& channel = info(kChannelOf<Message>);
    Message message{};
    message.seq = source.whole("seq");
    message.t_ns = source.whole("t_ns");
    message.session = source.whole("session");
    message.tag = source.whole("tag");
    const std::int64_t timestamp_us = source.whole("timestamp_us");
    if (timestamp_us < last_us_) throw WrongMessage{"the time stamps fall"};
    last_us_ = timestamp_us;
    Filler filler(source);
    each_field(message, filler);
    std::int64_t seq = 0, t_ns = 0;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    if (!is_whole_message(channel.channel, bytes.data(), bytes.size(), seq, t_ns))
      throw WrongMessage{"not a message that a process sends"};
    log_.write(message, timestamp_us);
    ++counts_[short_name(channel)];
  }

  WholeLog log_;
  std::map<std::string, std::int64_t> counts_;
  std::int64_t last_us_ = std::numeric_limits<std::int64_t>::min();
};

const ChannelInfo* channel_of(std::string_view name) {
  for (const ChannelInfo& channel : kChannels)
    if (short_name(channel) == name) return &channel;
  return nullptr;
}

void fill_from_mcap(const std::string& path, LogFiller& log,
                    const std::function<void(double)>& progress) {
  std::int64_t number = 0;
  read_mcap(
      path,
      [&](const McapMessage& message) {
        ++number;
        const ChannelInfo* channel = channel_of(message.topic);
        if (!channel || message.encoding != "json" ||
            message.schema != "twinrate." + std::string(message.topic))
          return;
        const Json json = Json::parse(message.text, nullptr, false);
        if (!json.is_object())
          throw BadInput(fmt::format("{}: message {}: no JSON object", path, number));
        for (const char* name : mcap::kOriginNames)
          if (!json.contains(name))
            throw BadInput(fmt::format(
                "{}: message {} has no {}: resampled, or of an earlier program; no log comes of it",
                path, number, name));
        try {
          log.put(*channel, JsonSource(json));
        } catch (const WrongMessage& wrong) {
          throw BadInput(fmt::format("{}: message {} ({}): {}", path, number,
                                     std::string(message.topic), wrong.what));
        }
      },
      progress);
}

void fill_from_mat(const std::string& path, LogFiller& log,
                   const std::function<void(double)>& progress) {
  const std::vector<MatVariable> streams = read_mat(path);
  struct Row {
    std::int64_t event;
    std::size_t stream, row;
  };
  std::vector<Row> rows;
  std::vector<std::optional<MatSource>> sources(streams.size());
  std::size_t s = 0;
  try {
    for (; s < streams.size(); ++s) {
      const auto event = std::find_if(streams[s].parts.begin(), streams[s].parts.end(),
                                      [](const MatVariable& f) { return f.name == "event"; });
      if (!channel_of(streams[s].name) || event == streams[s].parts.end()) continue;
      sources[s].emplace(streams[s], 0);
      for (std::size_t row = 0; row < event->rows; ++row) {
        sources[s]->go_to(row);
        rows.push_back({sources[s]->whole("event"), s, row});
      }
    }
    std::sort(rows.begin(), rows.end(),
              [](const Row& a, const Row& b) { return a.event < b.event; });
    if (!rows.empty() && rows.front().event < 0)
      throw BadInput(fmt::format("{}: a resampled export; no log comes of it", path));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      s = rows[i].stream;
      sources[s]->go_to(rows[i].row);
      log.put(*channel_of(streams[s].name), *sources[s]);
      if (progress && i % 16384 == 0)
        progress(static_cast<double>(i) / static_cast<double>(rows.size()));
    }
  } catch (const WrongMessage& wrong) {
    throw BadInput(fmt::format("{}: {}: {}", path, streams[s].name.substr(0, 40), wrong.what));
  }
}

}  // namespace

bool is_exported_log(const std::string& path) {
  if (path.ends_with(".mcap")) return true;
  if (!path.ends_with(".mat")) return false;
  const std::vector<MatVariable> streams = read_mat(path);
  return std::any_of(streams.begin(), streams.end(), [](const MatVariable& v) {
    return channel_of(v.name) && std::any_of(v.parts.begin(), v.parts.end(), [](const auto& field) {
             return field.name == "session";
           });
  });
}

std::map<std::string, std::int64_t> import_exported_log(
    const std::string& path, const std::string& out, const std::function<void(double)>& progress) {
  LogFiller log(out);
  if (path.ends_with(".mcap"))
    fill_from_mcap(path, log, progress);
  else
    fill_from_mat(path, log, progress);
  return log.finish(path);
}

}  // namespace twinrate

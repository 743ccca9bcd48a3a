#include "core/event_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/decode.hpp"
#include "core/log_marks.hpp"
#include "core/message_check.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kSync = 0xEDA1DA01;
constexpr std::int64_t kHeaderBytes = 28, kMaxChannelBytes = 63;  // LCM_MAX_CHANNEL_NAME_LENGTH
constexpr std::int64_t kMaxLateTicks = 64;  // of a message in a log written as it came
constexpr std::int64_t kMaxTimeError_ns = 1'000'000'000;  // of an imported sample, to its tick

std::int64_t big_endian(const std::uint8_t* bytes, int count) {
  std::uint64_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | bytes[i];
  return count == 4 ? static_cast<std::int32_t>(value) : static_cast<std::int64_t>(value);
}

bool is_printable(const std::string& name) {
  return std::all_of(name.begin(), name.end(), [](char c) { return c > 31 && c < 127; });
}

std::string suffix_of_first(const std::string& channel) {
  const std::string name = info(Channel::kManifest).name;
  return channel.starts_with(name) ? channel.substr(name.size()) : "";
}

}  // namespace

std::vector<std::string> log_parts(const std::string& path) {
  if (!fs::is_directory(path)) {
    if (!fs::is_regular_file(path)) throw BadInput(fmt::format("{}: no such log", path));
    return {path};
  }
  std::vector<std::string> parts;
  const fs::path first = fs::path(path) / "log.lcm";
  if (!fs::is_regular_file(first))
    throw BadInput(fmt::format("{}: no log.lcm in this directory", path));
  parts.push_back(first.string());
  for (int part = 1;; ++part) {
    const fs::path next = fs::path(path) / fmt::format("log-{:03}.lcm", part);
    if (!fs::is_regular_file(next)) break;
    parts.push_back(next.string());
  }
  return parts;
}

EventLog::EventLog(const std::string& path, OnDamage on_damage, const std::string& channel_suffix)
    : path_(path), suffix_(channel_suffix), on_damage_(on_damage), parts_(log_parts(path)) {
  for (const std::string& part : parts_)
    bytes_.push_back(static_cast<std::int64_t>(fs::file_size(part)));
  open_part(0, 0);
  if (suffix_.empty() && read_event(0).empty()) suffix_ = suffix_of_first(event_.channel);
  for (const ChannelInfo& c : kChannels) names_[c.name + suffix_] = c.channel;
}

bool EventLog::open_part(std::size_t part, std::int64_t byte) {
  if (part == parts_.size()) return false;
  if (!file_ || part != part_) {
    file_.reset(std::fopen(parts_[part].c_str(), "rb"));
    if (!file_) throw BadInput(fmt::format("{}: cannot be read", parts_[part]));
  }
  part_ = part;
  at_ = byte;
  last_number_.reset();
  return true;
}

void EventLog::go_to(const Place& place) {
  open_part(place.part, place.byte);
  last_timestamp_.reset();
  order_ = {};
  end_missing_.clear();
  open_ = continues_ = false;
  jumped_ = true;
  ended_ = false;
}

std::string EventLog::read_header(std::int64_t byte, Header& header) {
  std::uint8_t bytes[kHeaderBytes];
  const std::int64_t left = bytes_[part_] - byte;
  if (left < kHeaderBytes) return fmt::format("the event is cut off after {} bytes", left);
  if (ftello(file_.get()) != byte) fseeko(file_.get(), byte, SEEK_SET);
  if (std::fread(bytes, 1, sizeof bytes, file_.get()) != sizeof bytes) return "cannot be read";
  if (static_cast<std::uint32_t>(big_endian(bytes, 4)) != kSync) return "no event begins here";
  header = {big_endian(bytes + 4, 8), big_endian(bytes + 12, 8), big_endian(bytes + 20, 4),
            big_endian(bytes + 24, 4)};
  if (header.channel_bytes < 1 || header.channel_bytes > kMaxChannelBytes)
    return fmt::format("a channel name of {} bytes", header.channel_bytes);
  if (header.data_bytes < 0 || header.data_bytes > static_cast<std::int64_t>(kMaxMessageBytes))
    return fmt::format("a message of {} bytes", header.data_bytes);
  if (kHeaderBytes + header.channel_bytes + header.data_bytes > left)
    return fmt::format("the event is cut off after {} bytes", left);
  return "";
}

std::string EventLog::read_event(std::int64_t byte) {
  if (std::string why = read_header(byte, header_); !why.empty()) return why;
  event_.channel.resize(static_cast<std::size_t>(header_.channel_bytes));
  data_.resize(static_cast<std::size_t>(header_.data_bytes));
  if (std::fread(event_.channel.data(), 1, event_.channel.size(), file_.get()) !=
          event_.channel.size() ||
      std::fread(data_.data(), 1, data_.size(), file_.get()) != data_.size())
    return "cannot be read";
  event_.eventnum = header_.number;
  event_.timestamp = header_.timestamp;
  event_.data = data_.data();
  event_.datalen = static_cast<std::int32_t>(data_.size());
  return "";
}

std::string EventLog::wrong_order() {
  const std::int64_t expected = last_number_ ? *last_number_ + 1 : 0;
  const bool known = last_number_ || at_ == 0;
  last_number_ = header_.number;
  const std::optional<std::int64_t> before = last_timestamp_;
  if (header_.timestamp >= 0) last_timestamp_ = header_.timestamp;
  if (known && header_.number != expected)
    return fmt::format("event {} expected, found {}", expected, header_.number);
  if (header_.timestamp < 0 || (before && header_.timestamp < *before))
    return "the time stamp goes back";
  if (before && header_.timestamp - *before > kLongestGap_us)
    return fmt::format("the time stamp jumps by {} days",
                       (header_.timestamp - *before) / kLongestGap_us);
  return "";
}

// A log played twice into a logger starts again at its first tick.
bool EventLog::goes_back(Channel channel, std::int64_t seq) {
  TickOrder& order = order_[static_cast<std::size_t>(channel)];
  const bool falls = order.last >= 0 && seq < order.last;
  const bool starts_again = falls && seq <= order.first;
  const bool back = falls && (order.fell || (!starts_again && order.last - seq > kMaxLateTicks));
  order.fell = falls;
  if (order.first < 0 || starts_again) order.first = seq;
  order.last = seq;
  return back;
}

std::string EventLog::wrong_time(std::int64_t seq, std::int64_t t_ns) const {
  if (!drive_) return "";
  const double expected = 1e9 * static_cast<double>(seq) * drive_->T_s();
  if (std::abs(static_cast<double>(t_ns) - expected) <= kMaxTimeError_ns) return "";
  return fmt::format("tick {} at {:.6g} s; {:.6g} s expected", seq,
                     1e-9 * static_cast<double>(t_ns), 1e-9 * expected);
}

void EventLog::take_manifest() {
  manifest_t manifest;
  drive_.reset();
  if (!decode(manifest, data_.data(), data_.size()) || manifest.config_toml.empty()) return;
  try {
    drive_ = Config::parse(manifest.config_toml, path_).drive();
  } catch (const BadInput&) {  // who needs the drive file reports it
  }
}

std::string EventLog::wrong_content() {
  channel_.reset();
  if (!is_printable(event_.channel)) return "the channel name is not a text";
  if (event_.channel == kLogMarkChannel) return take_mark() ? "" : "the mark of a log is damaged";
  const auto found = names_.find(event_.channel);
  if (found == names_.end()) return "";
  std::int64_t seq = 0, t_ns = 0;
  if (!has_fingerprint_of(found->second, data_.data(), data_.size()))
    return fmt::format("{} has another type version than this program, or is damaged",
                       event_.channel);
  if (!is_whole_message(found->second, data_.data(), data_.size(), seq, t_ns))
    return fmt::format("{} is damaged", event_.channel);
  if (found->second == Channel::kManifest) take_manifest();
  if (found->second < Channel::kStatus) {
    if (std::string why = wrong_time(seq, t_ns); !why.empty()) return why;
    if (goes_back(found->second, seq))
      return fmt::format("{} goes back to tick {}", event_.channel, seq);
  }
  channel_ = found->second;
  return "";
}

bool EventLog::take_mark() {
  const std::string_view text(reinterpret_cast<const char*>(data_.data()), data_.size());
  const bool ends = text == kLogEnds || text == kLogContinues;
  if (!ends && text != kLogBegins && text != kLogGoesOn) return false;
  open_ = !ends;
  continues_ = text == kLogContinues;
  if (text == kLogGoesOn) end_missing_.clear();  // the logger before it was lost: the run says so
  return true;
}

// The next mark shows whether a part continues after its logger was lost.
void EventLog::end_of_part() {
  if (!end_missing_.empty()) note(at_, end_missing_);
  end_missing_ = open_ ? fmt::format("{} does not end: it was cut off", parts_[part_]) : "";
  open_ = continues_ = false;
}

void EventLog::end_of_log() {
  if (jumped_) return;
  compare_counts();
  const bool in_directory = path_ != parts_.front();
  if (!end_missing_.empty()) note(at_, end_missing_);
  if (open_)
    note(at_,
         "the log does not end: it was cut off, or its writer was killed or has not ended yet");
  if (continues_ && in_directory) note(at_, "the next part of the log is missing");
}

void EventLog::note(std::int64_t byte, const std::string& what) {
  const std::int64_t number = last_number_.value_or(-1) + 1;
  const std::string text =
      fmt::format("{}: event {}, byte {}: {}", parts_[part_], number, byte, what);
  if (on_damage_ == OnDamage::kRefuse)
    throw BadInput(text +
                   "; report, replay, export and trace read the undamaged part with --repair");
  if (damaged_++ == 0) first_damage_ = text;
}

std::int64_t EventLog::next_whole(std::int64_t byte) {
  fseeko(file_.get(), byte, SEEK_SET);
  std::uint32_t word = 0;
  for (int c = std::getc(file_.get()); c != EOF; c = std::getc(file_.get())) {
    word = word << 8 | static_cast<std::uint32_t>(c);
    if (word != kSync) continue;
    const std::int64_t begin = ftello(file_.get()) - 4;
    Header header;
    if (read_header(begin, header).empty()) return begin;
    fseeko(file_.get(), begin + 4, SEEK_SET);
  }
  return bytes_[part_];
}

const lcm::LogEvent* EventLog::next() {
  while (!ended_) {
    if (at_ == bytes_[part_]) {
      if (part_ + 1 < parts_.size()) end_of_part();
      if (open_part(part_ + 1, 0)) continue;
      ended_ = true;
      end_of_log();
      break;
    }
    place_ = {part_, at_};
    const std::int64_t byte = at_;
    if (const std::string why = read_event(byte); !why.empty()) {
      note(byte, why);
      at_ = next_whole(byte + 1);
      continue;
    }
    if (const std::string why = wrong_order(); !why.empty()) note(byte, why);  // whole all the same
    at_ = byte + kHeaderBytes + header_.channel_bytes + header_.data_bytes;
    if (const std::string why = wrong_content(); !why.empty()) {
      note(byte, why);
      continue;
    }
    if (channel_) ++counts_[static_cast<std::size_t>(*channel_)];
    return &event_;
  }
  return nullptr;
}

double EventLog::share_read() const {
  double before = 0, sum = 0;
  for (std::size_t part = 0; part < bytes_.size(); ++part) {
    if (part < part_) before += static_cast<double>(bytes_[part]);
    sum += static_cast<double>(bytes_[part]);
  }
  return ended_ ? 1 : (before + static_cast<double>(at_)) / std::max(1.0, sum);
}

std::string EventLog::damage() const {
  if (damaged_ < 2) return first_damage_;
  return fmt::format("{} ({} places)", first_damage_, damaged_);
}

// A log that was cut at the end of an event.
void EventLog::compare_counts() {
  const fs::path log = parts_.front();
  if (log.filename() != "log.lcm") return;
  std::ifstream file(log.parent_path() / "manifest.json");
  const auto manifest = nlohmann::json::parse(file, nullptr, false);
  if (!manifest.is_object() || !manifest.contains("logged") || !manifest["logged"].is_object())
    return;
  counted_ = true;
  for (const ChannelInfo& c : kChannels) {
    const auto logged = manifest["logged"].find(c.name);
    const std::int64_t here = counts_[static_cast<std::size_t>(c.channel)];
    if (logged != manifest["logged"].end() && logged->is_number_integer() &&
        logged->get<std::int64_t>() > here)
      note(at_, fmt::format("the log ends with {} of {} messages of {}", here,
                            logged->get<std::int64_t>(), c.name));
  }
}

}  // namespace twinrate

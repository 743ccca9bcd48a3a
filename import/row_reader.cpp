#include "import/row_reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "core/config.hpp"
#include "core/event_log.hpp"
#include "core/report_error.hpp"

namespace twinrate {
namespace {

constexpr double kDutyTolerance = 1e-3;  // beyond 0 to 1
constexpr double kLargest = 1e100;       // of a number: sums of its squares are finite
// 1 MHz, five times the fastest drive (rates.f_s_Hz); on the average of the first rows, as a jittering
// clock can give one pair of rows the same time but for its last digits.
constexpr double kLeastInterval_s = 1e-6;
constexpr std::int64_t kIntervalAfter = 200;  // rows, the least that a trace takes

// False if the text is not exactly one number.
bool parse_number(std::string_view text, char decimal, double& number) {
  char copy[64];
  if (decimal == ',' && text.size() < sizeof copy) {
    std::replace_copy(text.begin(), text.end(), copy, ',', '.');
    text = {copy, text.size()};
  }
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

std::string RowReader::Source::label() const {
  if (map.number > 0) return fmt::format("{} (column {})", name, map.number);
  return map.from == name ? name : fmt::format("{} (column \"{}\")", name, map.from);
}

RowReader::RowReader(const std::string& path, const ImportMap* map, bool repair, RowKind kind)
    : csv_(path, map ? map->format : CsvFormat{}),
      map_(map ? *map : canonical_map(csv_.header())),
      repair_(repair) {
  if (kind == RowKind::kWithoutTime) map_.columns.erase("t");
  width_ = csv_.header().size();
  for (const auto& [name, column] : map_.columns) {
    Source source{.name = name, .map = column};
    source.index = index_of(source);
    width_ = std::max(width_, source.index + 1);
    source.is_duty = name.starts_with("duty_");
    if (name == "t")
      has_time_ = source.is_time = true;
    else
      names_.push_back(name);
    sources_.push_back(std::move(source));
  }
  for (std::size_t i = 0; i < csv_.header().size(); ++i)
    if (std::none_of(sources_.begin(), sources_.end(),
                     [&](const Source& s) { return s.index == i; }))
      left_out_.push_back(printable(csv_.header()[i]));
  if (names_.empty())
    throw BadInput(fmt::format(
        "{}:{}: no column of a drive log besides t; a header of canonical names or --map is needed",
        path, std::max(csv_.header_line(), 1)));
}

std::size_t RowReader::index_of(const Source& source) const {
  const auto& header = csv_.header();
  if (source.map.number > 0) {
    if (!header.empty() && static_cast<std::size_t>(source.map.number) > header.size())
      throw BadInput(fmt::format("{}: {}: the file has {} columns", source.map.where,
                                 source.label(), header.size()));
    return static_cast<std::size_t>(source.map.number - 1);
  }
  const auto found = std::find(header.begin(), header.end(), source.map.from);
  if (found == header.end())
    throw BadInput(fmt::format(
        "{}:{}: missing column \"{}\"{}; the file has {}", csv_.path(),
        std::max(csv_.header_line(), 1), source.map.from,
        source.map.where.empty() ? "" : fmt::format(" (asked for at {})", source.map.where),
        fmt::join(header, ", ")));
  if (std::find(found + 1, header.end(), source.map.from) != header.end())
    throw BadInput(fmt::format("{}:{}: column \"{}\" stands twice; once allowed", csv_.path(),
                               csv_.header_line(), source.map.from));
  return static_cast<std::size_t>(found - header.begin());
}

bool RowReader::next() {
  while (csv_.next(fields_)) {
    if (csv_.at_end() && csv_.stream_cut_off()) return leave_out_cut_stream();
    if (take()) return true;
  }
  return false;
}

bool RowReader::take() {
  if (fields_.size() < width_) {
    const std::string what = fmt::format("{} of {} fields", fields_.size(), width_);
    if (csv_.at_end()) return leave_out_truncated(what);
    fail(what + "; every row needs all of them");
  }
  const bool extra = !csv_.header().empty() && fields_.size() > width_;
  if (extra && std::any_of(fields_.begin() + static_cast<std::ptrdiff_t>(width_), fields_.end(),
                           [](auto f) { return !f.empty(); }))
    fail(fmt::format("{} fields, the header has {}", fields_.size(), width_));
  if (csv_.at_end() && csv_.cut_off()) {
    if (fields_.back().size() < shortest_last_)
      return leave_out_truncated(
          "it has no line end, and its last field is shorter than in every other row");
  } else {
    shortest_last_ = std::min(shortest_last_, fields_.back().size());
  }
  values_.clear();
  bool cut = false;
  for (const Source& source : sources_) {
    const double value = number(source, cut);
    if (cut) return leave_out_truncated(source.label() + " is cut off");
    if (source.is_time)
      t_ = value;
    else
      values_.push_back(value);
  }
  return !has_time_ || time_rises();
}

double RowReader::number(const Source& source, bool& cut) {
  double raw = 0;
  const std::string_view text = fields_[source.index];
  if (!parse_number(text, map_.format.decimal, raw)) {
    cut = csv_.at_end() && csv_.cut_off();
    if (cut) return 0;
    fail(fmt::format("{}: a number needed, found \"{}\"", source.label(), text.substr(0, 40)));
  }
  if (!std::isfinite(raw))
    fail(fmt::format("{}: a finite number needed, found \"{}\"", source.label(), text));
  if (std::abs(raw) > kLargest)
    fail(fmt::format("{}: {:g} to {:g} allowed, found \"{}\"", source.label(), -kLargest, kLargest,
                     text.substr(0, 40)));
  if (source.map.wrap > 0) raw = unwrapped(source.map, raw);
  const double value = source.map.scale * raw + source.map.offset;
  if (source.is_duty && std::abs(value - 0.5) > 0.5 + kDutyTolerance)
    fail(fmt::format("{}: 0 to 1 allowed, found {:.6g}", source.label(), value));
  return value;
}

double RowReader::unwrapped(const ColumnMap& map, double raw) {
  turns_ -= std::round((raw - raw_angle_before_.value_or(raw)) / map.wrap);
  raw_angle_before_ = raw;
  return raw + map.wrap * turns_;
}

bool RowReader::time_rises() {
  const std::optional<double> before = t_before_;
  if (!before || t_ > *before) {
    const double longest_s = 1e-6 * static_cast<double>(kLongestGap_us);  // of the log's readers
    if (before && t_ - *before > longest_s)
      fail(
          fmt::format("time jumps by {:.3g} days from {} s to {} s; at most one day between two "
                      "rows is allowed",
                      (t_ - *before) / longest_s, *before, t_));
    t_before_ = t_;
    check_interval();
    return true;
  }
  if (t_ < *before)
    fail(fmt::format("time decreases from {} s to {} s; it must increase", *before, t_));
  if (!repair_)
    fail(fmt::format(
        "time repeats at {} s (a repeated sample?); it must increase; --repair skips such rows",
        t_));
  if (repeated_++ == 0) first_repeated_ = csv_.line();
  return false;
}

// Refuses a time in another unit, or none: no drive is sampled faster.
void RowReader::check_interval() {
  if (rising_++ == 0) t_first_ = t_;
  if (rising_ != kIntervalAfter) return;
  const double interval = (t_ - t_first_) / static_cast<double>(kIntervalAfter - 1);
  if (interval < 0.99 * kLeastInterval_s)
    fail(fmt::format("rows {:.3g} s apart; at least {:g} s allowed: is t in seconds?", interval,
                     kLeastInterval_s));
}

bool RowReader::leave_out_truncated(const std::string& what) {
  if (!repair_) fail("truncated last line: " + what + "; --repair skips it");
  truncated_note_ = fmt::format("truncated last line {} skipped", csv_.line());
  return false;
}

// The last line may be incomplete, whatever fields it has.
bool RowReader::leave_out_cut_stream() {
  if (!repair_)
    fail("the compressed file is cut off here; --repair uses the lines before this one");
  truncated_note_ = fmt::format("the compressed file is cut off; line {} skipped", csv_.line());
  return false;
}

// Only for files without a map: a map names its columns.
void RowReader::note_unknown_columns(std::vector<std::string>& notes) const {
  if (!map_.toml.empty()) return;
  std::vector<std::string> unknown;
  for (const std::string& name : left_out_) {
    if (name.empty()) continue;
    const auto& known = canonical_columns();
    const auto meant = std::find_if(known.begin(), known.end(), [&](const std::string& k) {
      return std::equal(k.begin(), k.end(), name.begin(), name.end(), [](char a, char b) {
        return std::tolower(static_cast<unsigned char>(a)) ==
               std::tolower(static_cast<unsigned char>(b));
      });
    });
    if (meant == known.end())
      unknown.push_back(name);
    else
      notes.push_back(
          fmt::format("{}: not a column of a drive log; did you mean {}?", name, *meant));
  }
  if (!unknown.empty())
    notes.push_back(fmt::format("{}: not {} of a drive log, ignored", fmt::join(unknown, ", "),
                                unknown.size() == 1 ? "a column" : "columns"));
}

std::vector<std::string> RowReader::notes() const {
  std::vector<std::string> notes;
  note_unknown_columns(notes);
  if (!map_.linear.empty())
    notes.push_back(
        fmt::format("{}: a linear axis, read as a rotary one of radius {:.4g} m{}",
                    fmt::join(map_.linear, ", "), map_.radius_m,
                    map_.toml.empty() ? " ([axis] travel_m of a map sets another)" : ""));
  if (!truncated_note_.empty()) notes.push_back(truncated_note_);
  if (repeated_ > 0)
    notes.push_back(fmt::format("{} repeated sample{} skipped, the first at line {}", repeated_,
                                repeated_ == 1 ? "" : "s", first_repeated_));
  if (csv_.cut_off() && truncated_note_.empty())
    notes.push_back(fmt::format(
        "the file does not end with a line end; line {} has all its fields, the last one no "
        "shorter than the shortest of other rows, and was kept",
        csv_.line()));
  return notes;
}

void RowReader::go_to(const Place& place) {
  csv_.go_to(place);
  t_before_.reset();
  rising_ = 0;
  raw_angle_before_.reset();
  turns_ = 0;
}

void RowReader::fail(const std::string& what) const {
  throw BadInput(fmt::format("{}:{}: {}", csv_.path(), csv_.line(), what));
}

}  // namespace twinrate

#include "tools/import/drive_rows.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/config.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

struct Source {
  std::string name;  // canonical
  ColumnMap map;
  std::size_t index = 0;  // field of the record
  std::vector<double>* values = nullptr;
  std::string label() const {
    if (map.number > 0) return fmt::format("{} (column {})", name, map.number);
    return map.from == name ? name : fmt::format("{} (column \"{}\")", name, map.from);
  }
};

std::size_t index_of(const CsvReader& csv, const Source& source) {
  const auto& header = csv.header();
  if (source.map.number > 0) {
    if (!header.empty() && static_cast<std::size_t>(source.map.number) > header.size())
      throw BadInput(fmt::format("{}: {}: the file has {} columns", source.map.where,
                                 source.label(), header.size()));
    return static_cast<std::size_t>(source.map.number - 1);
  }
  const auto found = std::find(header.begin(), header.end(), source.map.from);
  if (found == header.end())
    throw BadInput(fmt::format(
        "{}:{}: missing column \"{}\"{}; the file has {}", csv.path(),
        std::max(csv.header_line(), 1), source.map.from,
        source.map.where.empty() ? "" : fmt::format(" (asked for at {})", source.map.where),
        fmt::join(header, ", ")));
  if (std::find(found + 1, header.end(), source.map.from) != header.end())
    throw BadInput(fmt::format("{}:{}: column \"{}\" stands twice; once allowed", csv.path(),
                               csv.header_line(), source.map.from));
  return static_cast<std::size_t>(found - header.begin());
}

// Empty where the text is not one whole number.
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

class RowReader {
 public:
  RowReader(CsvReader& csv, const ImportMap& map, DriveRows& rows, bool repair)
      : csv_(csv), map_(map), rows_(rows), repair_(repair) {
    for (const auto& [name, column] : map.columns) {
      Source source{.name = name, .map = column};
      source.index = index_of(csv, source);
      source.values = name == "t" ? &rows.t : &rows.columns[name];
      sources_.push_back(std::move(source));
    }
    width_ = csv.header().size();
    for (const Source& source : sources_) width_ = std::max(width_, source.index + 1);
    for (std::size_t i = 0; i < csv.header().size(); ++i)
      if (std::none_of(sources_.begin(), sources_.end(),
                       [&](const Source& s) { return s.index == i; }))
        rows.left_out.push_back(csv.header()[i]);
  }

  void read_all(const std::function<void(double)>& progress) {
    std::vector<std::string_view> fields;
    while (csv_.next(fields)) {
      if (take(fields)) check_time();
      if (progress && rows_.line.size() % 16384 == 0) progress(csv_.share_read());
    }
    if (repeated_ > 0)
      rows_.notes.push_back(fmt::format("{} repeated sample{} left out, the first at line {}",
                                        repeated_, repeated_ == 1 ? "" : "s", first_repeated_));
    if (csv_.cut_off() && !truncated_)
      rows_.notes.push_back(fmt::format(
          "the file does not end with a line end; line {} has all its fields and was kept",
          csv_.line()));
  }

 private:
  // False where the record was left out.
  bool take(const std::vector<std::string_view>& fields) {
    if (fields.size() < width_) {
      const std::string what = fmt::format("{} of {} fields", fields.size(), width_);
      if (csv_.at_end()) return truncated(what);
      fail(what + "; every row needs all of them");
    }
    const bool extra = !csv_.header().empty() && fields.size() > width_;
    if (extra && std::any_of(fields.begin() + static_cast<std::ptrdiff_t>(width_), fields.end(),
                             [](auto f) { return !f.empty(); }))
      fail(fmt::format("{} fields, the header has {}", fields.size(), width_));
    values_.clear();
    for (const Source& source : sources_) {
      double raw = 0;
      const std::string_view text = fields[source.index];
      if (!parse_number(text, map_.format.decimal, raw)) {
        if (csv_.at_end() && csv_.cut_off()) return truncated(source.label() + " is cut off");
        fail(fmt::format("{}: a number needed, found \"{}\"", source.label(), text.substr(0, 40)));
      }
      if (!std::isfinite(raw))
        fail(fmt::format("{}: a finite number needed, found \"{}\"", source.label(), text));
      values_.push_back(source.map.wrap > 0 ? raw : source.map.scale * raw + source.map.offset);
    }
    for (std::size_t i = 0; i < sources_.size(); ++i) sources_[i].values->push_back(values_[i]);
    rows_.line.push_back(csv_.line());
    return true;
  }

  void check_time() {
    const std::size_t n = rows_.t.size();
    if (n < 2 || rows_.t[n - 1] > rows_.t[n - 2]) return;
    const double now = rows_.t[n - 1], before = rows_.t[n - 2];
    if (now < before)
      fail(fmt::format("time goes back from {} s to {} s; it must rise", before, now));
    if (!repair_)
      fail(
          fmt::format("time stands still at {} s (a repeated sample?); it must rise, --repair "
                      "leaves such rows out",
                      now));
    if (repeated_++ == 0) first_repeated_ = csv_.line();
    for (const Source& source : sources_) source.values->pop_back();
    rows_.line.pop_back();
  }

  bool truncated(const std::string& what) {
    if (!repair_) fail("truncated last line: " + what + "; --repair leaves it out");
    rows_.notes.push_back(fmt::format("truncated last line {} left out", csv_.line()));
    truncated_ = true;
    return false;
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw BadInput(fmt::format("{}:{}: {}", csv_.path(), csv_.line(), what));
  }

  CsvReader& csv_;
  const ImportMap& map_;
  DriveRows& rows_;
  bool repair_;
  std::vector<Source> sources_;
  std::size_t width_ = 0;
  std::vector<double> values_;
  bool truncated_ = false;
  std::int64_t repeated_ = 0;
  int first_repeated_ = 0;
};

// Each step is taken the short way round one period.
void unwrap(std::vector<double>& angle, double period) {
  double turns = 0, before = angle.empty() ? 0 : angle.front();
  for (double& value : angle) {
    const double raw = value;
    turns -= std::round((raw - before) / period);
    before = raw;
    value = raw + period * turns;
  }
}

void unwrap_position(const ColumnMap& map, DriveRows& rows) {
  std::vector<double>& theta_m = rows.columns.at("theta_m");
  if (map.wrap > 0) {
    unwrap(theta_m, map.wrap);
    for (double& value : theta_m) value = map.scale * value + map.offset;
    return;
  }
  const auto [lowest, highest] = std::minmax_element(theta_m.begin(), theta_m.end());
  if (*highest - *lowest <= 1.001 * kTwoPi) unwrap(theta_m, kTwoPi);
}

// `fewest`: rows that have to be there. `used`: with or without a time.
DriveRows read_rows(CsvReader& csv, const ImportMap& used, bool repair, std::size_t fewest,
                    const std::function<void(double)>& progress) {
  const std::string& path = csv.path();
  DriveRows rows;
  rows.path = path;
  RowReader reader(csv, used, rows, repair);
  if (rows.columns.empty())
    throw BadInput(fmt::format(
        "{}:{}: no column of a drive log besides t; a header of canonical names or --map is needed",
        path, std::max(csv.header_line(), 1)));
  reader.read_all(progress);
  if (rows.size() < fewest)
    throw BadInput(
        fmt::format("{}:{}: {} rows, at least {} needed", path, csv.line(), rows.size(), fewest));
  if (rows.has("theta_m")) unwrap_position(used.columns.at("theta_m"), rows);
  return rows;
}

}  // namespace

DriveRows read_drive_rows(const std::string& path, const ImportMap* map, bool repair,
                          const std::function<void(double)>& progress) {
  CsvReader csv(path, map ? map->format : CsvFormat{});
  return read_rows(csv, map ? *map : canonical_map(csv.header()), repair, kFewestRows, progress);
}

DriveRows read_static_rows(const std::string& path, const ImportMap* map, bool repair) {
  CsvReader csv(path, map ? map->format : CsvFormat{});
  ImportMap used = map ? *map : canonical_map(csv.header());
  used.columns.erase("t");
  return read_rows(csv, used, repair, kFewestStaticRows, {});
}

bool holds_time(const std::string& path, const ImportMap* map) {
  CsvReader csv(path, map ? map->format : CsvFormat{});
  if (map && (map->time_given || csv.header().empty())) return true;
  const std::string name = map ? map->columns.at("t").from : "t";
  return std::find(csv.header().begin(), csv.header().end(), name) != csv.header().end();
}

}  // namespace twinrate

#include "import/drive_rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/config.hpp"

namespace twinrate {
namespace {

// Each step becomes the shortest one modulo the period.
void unwrap(std::vector<double>& angle, double period) {
  double turns = 0, before = angle.empty() ? 0 : angle.front();
  for (double& value : angle) {
    const double raw = value;
    turns -= std::round((raw - before) / period);
    before = raw;
    value = raw + period * turns;
  }
}

DriveRows read_rows(RowReader& reader, std::size_t min_rows, std::size_t max_rows,
                    const std::function<void(double)>& progress) {
  DriveRows rows;
  rows.path = reader.path();
  rows.left_out = reader.left_out();
  std::vector<std::vector<double>*> columns;
  for (const std::string& name : reader.names()) columns.push_back(&rows.columns[name]);
  while (rows.size() < max_rows && reader.next()) {
    if (reader.has_time()) rows.t.push_back(reader.t());
    for (std::size_t i = 0; i < columns.size(); ++i) columns[i]->push_back(reader.values()[i]);
    rows.line.push_back(reader.line());
    if (progress && rows.line.size() % 16384 == 0) progress(reader.share_read());
  }
  rows.notes = reader.notes();
  if (rows.size() < min_rows) fail_too_few(reader, rows.size(), min_rows);
  if (rows.has("theta_m") && reader.map().may_wrap()) unwrap_turns(rows.columns.at("theta_m"));
  return rows;
}

}  // namespace

void unwrap_turns(std::vector<double>& theta_m) {
  const auto [lowest, highest] = std::minmax_element(theta_m.begin(), theta_m.end());
  if (*highest - *lowest <= kOneTurnRange_rad) unwrap(theta_m, kTwoPi);
}

void fail_too_few(const RowReader& reader, std::size_t rows, std::size_t min_rows) {
  throw BadInput(fmt::format("{}:{}: {} rows, at least {} needed", reader.path(), reader.line(),
                             rows, min_rows));
}

DriveRows read_drive_rows(const std::string& path, const ImportMap* map, bool repair,
                          const std::function<void(double)>& progress, std::size_t max_rows) {
  RowReader reader(path, map, repair);
  return read_rows(reader, kMinRows, max_rows, progress);
}

DriveRows read_static_rows(const std::string& path, const ImportMap* map, bool repair,
                           const std::function<void(double)>& progress) {
  RowReader reader(path, map, repair, RowKind::kWithoutTime);
  return read_rows(reader, kMinStaticRows, SIZE_MAX, progress);
}

bool holds_time(const std::string& path, const ImportMap* map) {
  CsvReader csv(path, map ? map->format : CsvFormat{});
  if (map && (map->time_given || csv.header().empty())) return true;
  const std::string name = map ? map->columns.at("t").from : "t";
  return std::find(csv.header().begin(), csv.header().end(), name) != csv.header().end();
}

}  // namespace twinrate

#include "drive_log/measured_files.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/config.hpp"
#include "core/percent_line.hpp"
#include "drive_log/log_reader.hpp"
#include "drive_log/same_readings.hpp"
#include "import/drive_rows.hpp"
#include "trace/measured_result.hpp"

namespace twinrate {
namespace {

std::vector<std::string> header_of(const std::string& path, const CsvFormat& format) {
  return CsvReader(path, format).header();
}

bool fits(const ImportMap& map, const std::vector<std::string>& header) {
  return std::all_of(map.columns.begin(), map.columns.end(), [&](const auto& column) {
    const ColumnMap& from = column.second;
    if (column.first == "t" && !map.time_given) return true;
    return from.number > 0 || std::find(header.begin(), header.end(), from.from) != header.end();
  });
}

enum class FileKind { kFullLog, kPositionLog, kFluxMap, kInverterCurve, kHoldingCurrent };

FileKind kind_of_file(const std::string& path, const std::optional<ImportMap>& map) {
  std::set<std::string> names;
  if (map)
    for (const auto& [name, column] : map->columns) names.insert(name);
  else
    for (const auto& [name, column] : canonical_map(header_of(path, {})).columns)
      names.insert(name);
  const auto has = [&](const char* name) { return names.count(name) != 0; };
  const bool time = holds_time(path, map ? &*map : nullptr);
  if (!time) {
    StaticSet set;
    for (const std::string& name : names)
      if (name != "t") set.columns[name] = {};
    switch (kind_of(set)) {
      case StaticKind::kFluxMap:
        return FileKind::kFluxMap;
      case StaticKind::kInverterCurve:
        return FileKind::kInverterCurve;
      case StaticKind::kHoldingCurrent:
        return FileKind::kHoldingCurrent;
      case StaticKind::kNone:
        throw BadInput(fmt::format(
            "{}:1: no t, and no set without time either: i_d, i_q, psi_d, psi_q; a phase current "
            "and its voltage; or theta_m, i_q needed",
            path));
    }
  }
  const bool current_vector = has("i_d") || has("i_a") || has("i_alpha");
  return has("theta_m") && has("i_q") && !current_vector ? FileKind::kPositionLog
                                                         : FileKind::kFullLog;
}

struct Opened {
  std::string path;
  std::optional<ImportMap> map;
  FileKind kind;
  bool held_out;
};

DriveRows rows_of(const Opened& file, bool repair, const TraceHooks& hooks,
                  std::vector<std::string>& notes) {
  const auto reading = [&](double) {
    if (hooks.stopped()) throw Stopped{};
  };
  reading(0);
  const ImportMap* map = file.map ? &*file.map : nullptr;
  const bool time = file.kind == FileKind::kFullLog || file.kind == FileKind::kPositionLog;
  DriveRows rows = time ? read_drive_rows(file.path, map, repair, reading)
                        : read_static_rows(file.path, map, repair, reading);
  for (const std::string& note : rows.notes) notes.push_back(file.path + ": " + note);
  return rows;
}

PositionLog position_log(DriveRows rows, bool held_out) {
  PositionLog log{.path = rows.path, .t = std::move(rows.t), .held_out = held_out};
  const auto take = [&](const char* name, std::vector<double>& to) {
    if (rows.has(name)) to = std::move(rows.columns.at(name));
  };
  take("theta_m", log.theta_m);
  take("i_q", log.i_q);
  take("omega_m", log.omega_m);
  take("u_q", log.u_q);
  return log;
}

TraceResult trace_static(const std::vector<Opened>& files, const MeasuredFiles& asked,
                         const DriveConfig& drive, const TraceHooks& hooks,
                         std::vector<std::string>& notes) {
  StaticSet set;
  std::vector<char> held_out;
  for (const Opened& file : files) {
    DriveRows rows = rows_of(file, asked.repair, hooks, notes);
    set.path += (set.path.empty() ? "" : ", ") + file.path;
    for (auto& [name, values] : rows.columns) {
      auto& all = set.columns[name];
      all.insert(all.end(), values.begin(), values.end());
    }
    set.file.resize(held_out.size() + rows.size(), static_cast<int>(set.files.size()));
    set.files.push_back(file.path);
    held_out.resize(held_out.size() + rows.size(), file.held_out);
  }
  for (const auto& [name, values] : set.columns)
    if (values.size() != held_out.size())
      throw BadInput(fmt::format("{}: column {} is not in every file", set.path, name));
  if (asked.held_out.empty()) held_out.clear();
  if (asked.held_out.empty() && asked.share) {
    const auto every = static_cast<std::size_t>(std::lround(1 / *asked.share));
    for (std::size_t k = 0; k < set.size(); ++k) held_out.push_back(k % every == every - 1);
  }
  const bool map = files.front().kind == FileKind::kFluxMap;
  hooks.tell(fmt::format("{} points", set.size()));
  const auto trace_set = map ? trace_flux_map : trace_inverter_curve;
  const StaticTrace trace = trace_set(set, drive.facts(), held_out, hooks, asked.considered);
  return static_result(set, trace, map ? StaticKind::kFluxMap : StaticKind::kInverterCurve);
}

// Empty if all files are drive logs without i_d.
std::optional<TraceResult> trace_position_files(const std::vector<Opened>& files,
                                                const MeasuredFiles& asked,
                                                const DriveConfig& drive, const TraceHooks& hooks,
                                                std::vector<std::string>& notes) {
  std::vector<PositionLog> logs;
  logs.reserve(files.size());
  for (const Opened& file : files)
    logs.push_back(position_log(rows_of(file, asked.repair, hooks, notes), file.held_out));
  if (std::all_of(logs.begin(), logs.end(),
                  [&](const PositionLog& log) { return is_drive_log(log, drive.machine); }))
    return {};
  std::vector<ReadRows> read;
  for (const PositionLog& log : logs) {
    ReadRows& file = read.emplace_back(ReadRows{log.path, log.held_out, {}});
    for (std::size_t k = 0; k < log.size(); ++k)
      file.rows.push_back(reading_hash({log.theta_m[k], log.i_q[k]}));
  }
  expect_other_readings(read);
  if (asked.held_out.empty()) logs = hold_out(logs, asked.share.value_or(0.25), drive.machine);
  hooks.tell(fmt::format("{} logs of angle and current", files.size()));
  return trace_positions(logs, drive.facts(), {.hooks = hooks, .considered = asked.considered});
}

}  // namespace

std::optional<ImportMap> map_for(const std::string& path, const std::vector<std::string>& maps) {
  if (maps.empty()) return {};
  if (maps.size() == 1) return read_import_map(maps.front());
  for (const std::string& name : maps) {
    ImportMap map = read_import_map(name);
    if (fits(map, header_of(path, map.format))) return map;
  }
  throw BadInput(fmt::format("{}:1: none of the maps {} fits; the file has {}", path,
                             fmt::join(maps, ", "), fmt::join(header_of(path, {}), ", ")));
}

std::optional<TraceResult> trace_measured_files(const MeasuredFiles& asked,
                                                const DriveConfig& drive, const TraceHooks& hooks) {
  std::vector<Opened> files;
  for (const bool held_out : {false, true})
    for (const std::string& path : held_out ? asked.held_out : asked.data) {
      if (is_run_log(path)) return {};
      auto map = map_for(path, asked.maps);
      const FileKind kind = kind_of_file(path, map);
      files.push_back({path, std::move(map), kind, held_out});
    }
  const auto all = [&](auto of_kind) {
    return std::all_of(files.begin(), files.end(),
                       [&](const Opened& f) { return of_kind(f.kind); });
  };
  const FileKind first = files.front().kind;
  if (all([](FileKind k) { return k == FileKind::kFullLog; })) return {};
  std::vector<std::string> notes;
  std::optional<TraceResult> result;
  if (all([](FileKind k) { return k == FileKind::kPositionLog || k == FileKind::kHoldingCurrent; }))
    result = trace_position_files(files, asked, drive, hooks, notes);
  else if (all([&](FileKind k) { return k == first; }))
    result = trace_static(files, asked, drive, hooks, notes);
  else
    throw BadInput(
        "--data, --holdout: the files are of different kinds (full drive logs, logs of angle and "
        "current, sets without time); give one kind at a time");
  if (!result) return {};
  result->sources = asked.data;
  result->held_out_sources = asked.held_out;
  result->health.insert(result->health.end(), notes.begin(), notes.end());
  return result;
}

}  // namespace twinrate

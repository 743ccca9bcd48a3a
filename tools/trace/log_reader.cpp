#include "tools/trace/log_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "core/config.hpp"
#include "tools/import/drive_rows.hpp"
#include "tools/load_drive.hpp"
#include "trace/measured.hpp"

namespace twinrate {
namespace {

class CsvLog final : public LogReader {
 public:
  CsvLog(const std::string& path, const ImportMap* map, bool repair) : rows_(path, map, repair) {
    const auto& names = rows_.names();
    const auto index_of = [&](const std::string& name) {
      return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
    };
    for (const RawColumn& c : raw_columns()) {
      std::size_t index = index_of(c.name);
      // A torque sensor on the shaft.
      if (index == names.size() && c.values == &RawLog::T_load) index = index_of("torque");
      if (index < names.size()) columns_.push_back({c.values, index});
    }
  }
  bool next(RawLog& piece, std::size_t rows) override {
    piece.clear();
    piece.path = rows_.path();
    while (piece.size() < rows && rows_.next()) {
      piece.t.push_back(rows_.t());
      for (const auto& [values, index] : columns_) (piece.*values).push_back(rows_.values()[index]);
    }
    return piece.size() > 0;
  }
  double share_read() const override { return rows_.share_read(); }
  std::vector<std::string> notes() const override { return rows_.notes(); }
  void expect_enough(std::size_t rows) const override {
    if (rows < kFewestRows) fail_too_few(rows_, rows, kFewestRows);
  }
  bool may_start_again() const override {
    const auto angle = rows_.map().columns.find("theta_m");
    return angle != rows_.map().columns.end() && angle->second.wrap == 0;
  }
  Place place() override { return rows_.place(); }
  void go_to(const Place& place) override { rows_.go_to(std::get<RowReader::Place>(place)); }

 private:
  struct Column {
    std::vector<double> RawLog::*values;
    std::size_t index;
  };
  RowReader rows_;
  std::vector<Column> columns_;
};

// The voltage is moved to the row it begins at; the external load is that of the config in the log.
class RecordedRun final : public LogReader {
 public:
  explicit RecordedRun(const std::string& path) : path_(path), measurements_(path) {
    measurements_.peek();
    if (measurements_.config_toml().empty()) return;
    load_.emplace(Config::parse(measurements_.config_toml(), path).drive());
  }
  bool next(RawLog& piece, std::size_t rows) override {
    piece.clear();
    piece.path = path_;
    Measurement m;
    while (piece.size() < rows && measurements_.next(m)) {
      const Measurement* following = measurements_.peek();
      if (!following) break;
      const double T_load = load_ ? load_->at(1e-9 * static_cast<double>(m.t_ns)) : 0;
      append_row(piece, m, following->u_alphabeta, load_ ? &T_load : nullptr);
    }
    return piece.size() > 0;
  }
  double share_read() const override { return measurements_.share_read(); }
  void expect_enough(std::size_t rows) const override {
    if (rows < kFewestRows)
      throw BadInput(
          fmt::format("{}: {} measurements, at least {} needed", path_, rows, kFewestRows));
  }
  Place place() override { return RunPlace{measurements_.place(), load_ ? load_->now() : 0}; }
  void go_to(const Place& place) override {
    const auto& there = std::get<RunPlace>(place);
    measurements_.go_to(there.place);
    if (load_) load_->go_on_from(there.T_load);
  }

 private:
  std::string path_;
  MeasurementReader measurements_;
  std::optional<DeclaredLoad> load_;
};

}  // namespace

bool is_run_log(const std::string& path) {
  return std::filesystem::is_directory(path) || path.ends_with(".lcm");
}

std::unique_ptr<LogReader> open_log(const std::string& path, const ImportMap* map, bool repair) {
  if (is_run_log(path)) return std::make_unique<RecordedRun>(path);
  return std::make_unique<CsvLog>(path, map, repair);
}

}  // namespace twinrate

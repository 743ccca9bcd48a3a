#include "verify/verify_logs.hpp"

#include <algorithm>
#include <cmath>

#include "core/measurement_reader.hpp"
#include "drive_log/log_reader.hpp"
#include "drive_log/measured_files.hpp"
#include "import/drive_messages.hpp"

namespace twinrate {
namespace {

// The first rows of a log as MEASUREMENTs for an estimator.
std::vector<Measurement> measurements_of(const std::string& path, const ImportMap* map, bool repair,
                                         const DriveConfig& drive, std::size_t rows) {
  std::vector<Measurement> list;
  if (is_run_log(path)) {
    MeasurementReader reader(path, repair ? OnDamage::kSkip : OnDamage::kRefuse);
    for (Measurement m; list.size() < rows && reader.next(m);) list.push_back(m);
    return list;
  }
  const DriveRows read = read_drive_rows(path, map, repair, {}, rows);
  const TickGrid grid = place_on_grid(read, drive.rates.f_s_Hz);
  const DriveMessages messages(read, drive.machine.n_p, drive.inverter.v_dc);
  for (const TickGrid::Slot& slot : grid.slots) list.push_back(messages.measurement(slot));
  return list;
}

// For each row of `log`: true if no row of the same file in `traced` trained at its time.
std::vector<char> unseen_rows(const Record& log, const Record& traced, const DriveLog& file,
                              const std::vector<char>& held_out) {
  std::vector<char> unseen(log.size(), 1);
  const auto begin = traced.t.begin() + static_cast<std::ptrdiff_t>(file.first),
             end = traced.t.begin() + static_cast<std::ptrdiff_t>(file.end);
  for (std::size_t k = 0; k < log.size(); ++k) {
    const double t = log.t[k] + file.time_offset_s;
    const auto row = std::lower_bound(begin, end, t - 0.5 * log.T_s);
    if (row == end || *row > t + 0.5 * log.T_s) continue;
    unseen[k] = held_out[static_cast<std::size_t>(row - traced.t.begin())];
  }
  return unseen;
}

}  // namespace

std::vector<VerifyLog> verify_logs(const LogRequest& asked, const DriveConfig& drive,
                                   const DriveLogs& logs, const std::vector<char>& held_out) {
  std::vector<VerifyLog> list;
  for (const DriveLog& file : logs.files) {
    if (!file.held_out && !asked.held_out.empty()) continue;
    const std::optional<ImportMap> map =
        is_run_log(file.path) ? std::nullopt : map_for(file.path, asked.maps);
    const ImportMap* columns = map ? &*map : nullptr;
    const std::size_t rows =
        std::min(file.health.rows, rows_within(asked.memory_MiB, file.health.T_s));
    const std::unique_ptr<LogReader> reader =
        open_log(file.path, columns, asked.repair, drive.inverter.v_dc);
    RawLog raw;
    reader->next(raw, rows);
    if (reader->may_wrap()) unwrap_turns(raw.theta_m);
    VerifyLog log{.path = file.path};
    log.record = record_of(raw, drive.machine.n_p, file.health);
    log.held_out = unseen_rows(log.record, logs.record, file, held_out);
    log.measurements = measurements_of(file.path, columns, asked.repair, drive, rows);
    list.push_back(std::move(log));
  }
  return list;
}

}  // namespace twinrate

#include "drive_log/trace_drive_logs.hpp"

#include <algorithm>

#include "drive_log/moments.hpp"
#include "trace/change_points.hpp"
#include "trace/consistency.hpp"
#include "trace/keys.hpp"

namespace twinrate {

std::vector<char> held_out_rows(const DriveLogs& logs, double share, int n_p) {
  const bool held_out_file = std::any_of(logs.files.begin(), logs.files.end(),
                                         [](const DriveLog& file) { return file.held_out; });
  return held_out_file ? logs.held_out() : held_out_rows(logs.record, share, n_p);
}

namespace {

// Three sensors that are wrong by the same make no current vector.
void note_common_offset(const Record& record, TraceResult& result) {
  const bool offset =
      std::any_of(result.effects.begin(), result.effects.end(),
                  [](const TracedEffect& e) { return has_key(*e.effect, "offset_a_A"); });
  if (!offset || record.current_sensors < 3) return;
  result.health.emplace_back(
      "an offset common to the three current sensors does not show in the current vector: the "
      "offsets are relative to that of phase c, which is taken for 0");
}

}  // namespace

TraceResult trace_drive_logs(const DriveLogs& logs, const std::vector<char>& held_out,
                             const DriveConfig& drive, const TraceSettings& settings) {
  TraceSettings of_files = settings;
  std::vector<Inconsistency> inconsistent;
  for (const DriveLog& file : logs.files) {
    inconsistent.insert(inconsistent.end(), file.inconsistent.begin(), file.inconsistent.end());
    of_files.files.push_back({file.path, file.first, file.end, file.held_out, file.time_offset_s});
    if (file.held_out) of_files.fit_judging_rows = false;
  }
  TraceResult result;
  if (inconsistent.empty()) {
    result = trace_with_changes(logs.record, drive, logs.health, of_files, held_out);
    find_moments(logs, drive, result);
    note_common_offset(logs.record, result);
  } else {
    result = inconsistent_result(std::move(inconsistent), logs.health);
  }
  for (const DriveLog& file : logs.files)
    (file.held_out ? result.held_out_sources : result.sources).push_back(file.path);
  result.health.insert(result.health.end(), logs.notes.begin(), logs.notes.end());
  return result;
}

}  // namespace twinrate

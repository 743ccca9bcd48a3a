// A drive log, whatever its format, as pieces of neighbouring rows.
#pragma once
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "core/measurement_reader.hpp"
#include "import/row_reader.hpp"
#include "trace/health.hpp"

namespace twinrate {

class LogReader {
 public:
  virtual ~LogReader() = default;
  // The next rows, at most `rows`, in place of what `piece` held; false where none are left. An
  // angle stands as the log has it (see may_start_again). Throws BadInput.
  virtual bool next(RawLog& piece, std::size_t rows) = 0;
  virtual double share_read() const = 0;
  // What was repaired or looks odd, one line each; complete at the end.
  virtual std::vector<std::string> notes() const { return {}; }
  // Throws BadInput where `rows`, all that the log has, are too few.
  virtual void expect_enough(std::size_t rows) const = 0;
  // A column of angles in which a jump may be the start of a new turn.
  virtual bool may_start_again() const { return false; }

  // Where the next row stands, and back to it.
  struct RunPlace {
    MeasurementReader::Place place;
    double T_load = 0;
  };
  using Place = std::variant<RowReader::Place, RunPlace>;
  virtual Place place() = 0;
  virtual void go_to(const Place& place) = 0;
};

bool is_run_log(const std::string& path);
// A CSV (through `map`, or with canonical names where it is null), or an LCM log. Duties of a CSV
// without a voltage become one; `v_dc_nominal`: of the drive, where the CSV has no v_dc. Throws
// BadInput.
std::unique_ptr<LogReader> open_log(const std::string& path, const ImportMap* map, bool repair,
                                    double v_dc_nominal);

}  // namespace twinrate

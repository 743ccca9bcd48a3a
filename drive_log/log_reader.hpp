// Reads a drive log of any format in pieces of consecutive rows.
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
  // Replaces `piece` by the next rows, at most `rows`; false at the end. Angles are as logged (see
  // may_wrap). Throws BadInput.
  virtual bool next(RawLog& piece, std::size_t rows) = 0;
  virtual double share_read() const = 0;
  // Repairs and suspect values, one line each; complete at the end.
  virtual std::vector<std::string> notes() const { return {}; }
  // The first damage of an LCM log of which only the undamaged part is read; complete at the end.
  virtual std::string damage() const { return ""; }
  // Throws BadInput if `rows`, the rows of the whole log, are too few.
  virtual void expect_enough(std::size_t rows) const = 0;
  // True if a jump of the logged angle may be the start of a new turn.
  virtual bool may_wrap() const { return false; }

  // Place of the next row, for go_to().
  struct RunPlace {
    MeasurementReader::Place place;
    double T_load = 0;
  };
  using Place = std::variant<RowReader::Place, RunPlace>;
  virtual Place place() = 0;
  virtual void go_to(const Place& place) = 0;
};

bool is_run_log(const std::string& path);
// Opens a CSV (`map` null: canonical names) or an LCM log. In a CSV without voltages, the voltage
// is duty times v_dc; `v_dc_nominal`: of the drive, for a CSV without v_dc. Throws BadInput.
std::unique_ptr<LogReader> open_log(const std::string& path, const ImportMap* map, bool repair,
                                    double v_dc_nominal);

}  // namespace twinrate

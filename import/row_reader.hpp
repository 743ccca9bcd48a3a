// The rows of a measured file, one after the other: canonical names, SI units, time rising.
//
// Throws BadInput, one line with file:line: missing column, text in a number, not finite, a duty
// beyond 0 to 1, time not rising, truncated last line.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "import/map.hpp"

namespace twinrate {

enum class RowKind { kWithTime, kWithoutTime };

class RowReader {
 public:
  // `map` null: the header holds canonical names. `repair`: a truncated last line and repeated
  // samples are left out and noted.
  RowReader(const std::string& path, const ImportMap* map, bool repair,
            RowKind kind = RowKind::kWithTime);

  // Columns in the order of values(), "t" left out.
  const std::vector<std::string>& names() const { return names_; }
  // Columns of the file that nothing is taken from.
  const std::vector<std::string>& left_out() const { return left_out_; }

  bool has_time() const { return has_time_; }

  bool next();  // false at the end
  double t() const { return t_; }
  // An angle that starts again at `wrap` of the map comes unwrapped, other angles as they are.
  const std::vector<double>& values() const { return values_; }
  int line() const { return csv_.line(); }

  // What was repaired or looks odd, one line each; complete at the end.
  std::vector<std::string> notes() const;
  double share_read() const { return csv_.share_read(); }
  const std::string& path() const { return csv_.path(); }
  int header_line() const { return csv_.header_line(); }
  const ImportMap& map() const { return map_; }

  // The place of the row that comes next, and back to one: turns of an angle that were counted up
  // to there start again at 0.
  using Place = CsvReader::Place;
  Place place() const { return csv_.place(); }
  void go_to(const Place& place);

 private:
  struct Source {
    std::string name;  // canonical
    ColumnMap map;
    std::size_t index = 0;  // field of the record
    bool is_time = false, is_duty = false;
    std::string label() const;
  };
  std::size_t index_of(const Source& source) const;
  bool take();  // false where the record is left out
  double number(const Source& source, bool& cut);
  bool time_rises();  // false where the row is left out
  bool leave_out_truncated(const std::string& what);
  double unwrapped(const ColumnMap& map, double raw);
  void note_unknown_columns(std::vector<std::string>& notes) const;
  [[noreturn]] void fail(const std::string& what) const;

  CsvReader csv_;
  ImportMap map_;
  bool repair_;
  std::vector<Source> sources_;
  bool has_time_ = false;
  std::vector<std::string> names_, left_out_;
  std::size_t width_ = 0;  // fields that a record needs
  std::vector<std::string_view> fields_;
  std::vector<double> values_;
  double t_ = 0;
  std::optional<double> t_before_, raw_angle_before_;
  double turns_ = 0;
  std::string truncated_note_;
  std::int64_t repeated_ = 0;
  int first_repeated_ = 0;
};

}  // namespace twinrate

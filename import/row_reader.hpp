// Reads a measured file row by row: canonical names, SI units, rising time.
//
// Throws BadInput, one line with file:line: missing column, text in a number, number not finite,
// duty outside 0 to 1, time not rising, truncated last line.
#pragma once
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "import/map.hpp"

namespace twinrate {

enum class RowKind { kWithTime, kWithoutTime };

class RowReader {
 public:
  // `map` null: the header holds canonical names. `repair`: drops a truncated last line and
  // repeated samples, with a note.
  RowReader(const std::string& path, const ImportMap* map, bool repair,
            RowKind kind = RowKind::kWithTime);

  // Columns in the order of values(), without "t".
  const std::vector<std::string>& names() const { return names_; }
  // Unused columns of the file.
  const std::vector<std::string>& left_out() const { return left_out_; }

  bool has_time() const { return has_time_; }

  bool next();  // false at the end
  double t() const { return t_; }
  // An angle with `wrap` in the map is unwrapped; other angles are unchanged.
  const std::vector<double>& values() const { return values_; }
  int line() const { return csv_.line(); }

  // Repairs and suspect values, one line each; complete at the end.
  std::vector<std::string> notes() const;
  double share_read() const { return csv_.share_read(); }
  const std::string& path() const { return csv_.path(); }
  int header_line() const { return csv_.header_line(); }
  const ImportMap& map() const { return map_; }

  // Place of the next row. go_to() restarts the count of turns of an unwrapped angle at 0.
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
  bool take();  // false if the record is dropped
  double number(const Source& source, bool& cut);
  bool time_rises();  // false if the row is dropped
  void check_interval();
  bool leave_out_cut_stream();
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
  std::size_t width_ = 0;  // fields needed in a record
  std::vector<std::string_view> fields_;
  std::vector<double> values_;
  double t_ = 0;
  std::optional<double> t_before_, raw_angle_before_;
  double t_first_ = 0;
  std::int64_t rising_ = 0;  // rows so far, each later than the one before
  double turns_ = 0;
  std::string truncated_note_;
  std::size_t shortest_last_ = std::numeric_limits<std::size_t>::max();  // characters, last field
  std::int64_t repeated_ = 0;
  int first_repeated_ = 0;
};

}  // namespace twinrate

// A CSV file (plain or gzipped) as a header and records of text fields, with line numbers for
// messages.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace twinrate {

struct CsvFormat {
  char separator = ',';  // ' ' means any run of blanks
  char decimal = '.';
  int skip = 0;               // lines before the header
  std::string comment = "#";  // lines that start so are left out; "" for none
  bool header = true;         // false: columns have numbers only
};

class CsvReader {
 public:
  // Throws BadInput: no such file, not readable, corrupt gzip stream, no header line.
  CsvReader(const std::string& path, const CsvFormat& format);

  // Names of the columns; empty where format.header is false.
  const std::vector<std::string>& header() const { return header_; }
  int header_line() const { return header_line_; }
  // The fields of the next record, valid until the next call; false at the end. Fields are trimmed,
  // quotes taken off; nothing is converted.
  bool next(std::vector<std::string_view>& fields);
  int line() const { return line_; }  // of the record last returned, from 1
  // True where no other record follows the one last returned.
  bool at_end() const { return next_.data() == nullptr; }
  // The file does not end with a line end (or its gzip stream was cut off).
  bool cut_off() const { return cut_off_; }
  double share_read() const;
  const std::string& path() const { return path_; }

 private:
  void load();
  bool take_line(std::string_view& line);
  void find_next();  // the next line that is neither empty nor a comment
  void split(std::string_view line, std::vector<std::string_view>& fields) const;

  std::string path_;
  CsvFormat format_;
  std::string text_;
  std::size_t position_ = 0;
  bool cut_off_ = false;
  std::vector<std::string> header_;
  int header_line_ = 0, line_ = 0, lines_taken_ = 0, next_line_ = 0;
  std::string_view next_;
};

// 64-bit FNV-1a of a file's bytes as stored, 16 hex digits: names a source in a manifest.
std::string file_hash(const std::string& path);

}  // namespace twinrate

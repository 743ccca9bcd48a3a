// Reads a CSV file (plain, gzipped, or the columns of a .mat: text_source.hpp) as a header and records of text fields, with line numbers for
// messages. Memory: one block, for a file of any length.
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "import/text_source.hpp"

namespace twinrate {

struct CsvFormat {
  char separator = ',';  // ' ' means any run of blanks
  char decimal = '.';
  int skip = 0;               // lines before the header
  std::string comment = "#";  // lines with this prefix are skipped; "": none
  bool header = true;         // false: columns have numbers only
};

class CsvReader {
 public:
  // Throws BadInput: no such file, not readable, no header line, another separator. next() throws
  // at the corrupt place of a gzip stream.
  CsvReader(const std::string& path, const CsvFormat& format);

  // Names of the columns; empty if format.header is false.
  const std::vector<std::string>& header() const { return header_; }
  int header_line() const { return header_line_; }
  // The fields of the next record, valid until the next call; false at the end. Fields are trimmed
  // and unquoted text.
  bool next(std::vector<std::string_view>& fields);
  int line() const { return line_; }  // of the record last returned, from 1
  // True if no record follows the one last returned.
  bool at_end() const { return !has_next_; }
  // At the end: the last line has no line end (or the gzip stream is truncated).
  bool cut_off() const { return cut_off_; }
  // At the end: the compressed stream stops in the middle; more rows were to follow.
  bool stream_cut_off() const { return text_->cut_off(); }
  double share_read() const;
  const std::string& path() const { return path_; }

  // Start of the next record. go_to() a place of the same file reads from there again.
  struct Place {
    std::int64_t byte = 0;  // of the text, unpacked
    int lines_before = 0;
  };
  Place place() const { return next_place_; }
  void go_to(const Place& place);

 private:
  void expect_separated() const;
  bool fill();  // reads on if the block holds no whole line; false at the end of the file
  bool take_line(std::string_view& line);
  void find_next();  // the next line that is neither empty nor a comment
  void split(std::string_view line, std::vector<std::string_view>& fields) const;

  std::string path_;
  CsvFormat format_;
  std::unique_ptr<TextSource> text_;
  std::string block_;             // part of the text; its last line may be incomplete
  std::size_t position_ = 0;      // in the block
  std::int64_t block_begin_ = 0;  // byte of the text at the start of the block
  bool ended_ = false, cut_off_ = false;
  std::vector<std::string> header_;
  int header_line_ = 0, line_ = 0, lines_taken_ = 0, next_line_ = 0;
  std::string current_, next_;  // the records' text
  Place next_place_;
  bool has_next_ = false;
};

// 64-bit FNV-1a hash of a file's stored bytes, 16 hex digits; identifies a source in a manifest.
std::string file_hash(const std::string& path);

}  // namespace twinrate

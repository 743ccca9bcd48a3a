// Where an export goes: streams (a channel each, or one table), sample after sample.
//
// A file is written as PATH.part and stands under its name once finish() was called; without it the
// part file goes. Throws BadInput where it cannot be created, std::runtime_error where the disk is
// full.
#pragma once
#include <memory>
#include <string>

#include "export/fields.hpp"

namespace twinrate {

class ExportSink {
 public:
  virtual ~ExportSink() = default;
  // Before the first sample of the stream; its place is the number of streams opened before.
  virtual void open(const std::string& stream, const Layout& layout) = 0;
  virtual void write(std::size_t stream, const Sample& sample) = 0;
  virtual void finish() = 0;
};

// The part file of `path`, renamed by finish().
class PartFile {
 public:
  explicit PartFile(const std::string& path);
  ~PartFile();
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  const std::string& part_path() const { return part_path_; }
  void finish();
  [[noreturn]] void fail() const;  // to write, by errno

 private:
  std::string path_, part_path_;
  bool done_ = false;
};

// One table: t and the fields of the one stream. Missing numbers (not a number) are empty cells.
// Gzipped where the name ends in .gz.
std::unique_ptr<ExportSink> make_csv_sink(const std::string& path);
// MATLAB 5 (libmatio): a struct a stream with t (s), seq, and a column vector a field, a matrix
// with a row a sample where the field is an array, a cell array for texts. Holds everything in
// memory.
std::unique_ptr<ExportSink> make_mat_sink(const std::string& path);
// MCAP (mcap.dev), uncompressed chunks with an index, messages as JSON with a JSON schema.
std::unique_ptr<ExportSink> make_mcap_sink(const std::string& path);

}  // namespace twinrate

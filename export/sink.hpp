// Writes the streams of an export (one for each channel, or one table) sample by sample.
//
// The file is a PartFile until finish(). Throws BadInput if it cannot be created,
// std::runtime_error if the disk is full.
#pragma once
#include <memory>
#include <string>

#include "export/fields.hpp"

namespace twinrate {

class ExportSink {
 public:
  virtual ~ExportSink() = default;
  // Call before the first sample of a stream. Its place is the number of streams opened before.
  virtual void open(const std::string& stream, const Layout& layout) = 0;
  virtual void write(std::size_t stream, const Sample& sample) = 0;
  virtual void finish() = 0;
};

// One table: t and the fields of the one stream. A missing number (NaN) is an empty cell. Gzipped
// if the name ends in .gz.
std::unique_ptr<ExportSink> make_csv_sink(const std::string& path);
// MATLAB 5 (libmatio): one struct for each stream with t (s), seq, the origin (t_ns, session, tag,
// timestamp_us, event) and its fields: a column vector, for an array field a matrix with one row a
// sample, for texts a cell array. Integers are doubles if these represent them exactly, else int64.
// The whole log is in memory.
std::unique_ptr<ExportSink> make_mat_sink(const std::string& path);
// MCAP (mcap.dev), chunks with an index, messages as JSON with a JSON schema. `compression`: "zstd",
// "lz4" or "" for none.
std::unique_ptr<ExportSink> make_mcap_sink(const std::string& path, const std::string& compression);

}  // namespace twinrate

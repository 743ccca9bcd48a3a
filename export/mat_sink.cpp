#include <fmt/format.h>
#include <matio.h>

#include <algorithm>
#include <limits>

#include "core/config.hpp"
#include "core/output_file.hpp"
#include "export/sink.hpp"

namespace twinrate {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMaxVariableBytes = std::numeric_limits<std::int32_t>::max();  // MAT 5

// All samples of one field, row by row; the row width is that of the longest array.
struct Rows {
  std::size_t width = 0, rows = 0;
  std::vector<double> values = {};

  void add(const double* numbers, std::size_t count) {
    if (count > width) widen(count);
    values.insert(values.end(), numbers, numbers + count);
    values.resize(values.size() + width - count, kNone);
    ++rows;
  }
  void widen(std::size_t to) {
    std::vector<double> wider(rows * to, kNone);
    for (std::size_t r = 0; r < rows; ++r)
      std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(r * width), width,
                  wider.begin() + static_cast<std::ptrdiff_t>(r * to));
    values = std::move(wider);
    width = to;
  }
  std::vector<double> by_column() const {
    std::vector<double> columns(values.size());
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t c = 0; c < width; ++c) columns[c * rows + r] = values[r * width + c];
    return columns;
  }
};

struct Stream {
  std::string name;
  Layout layout;
  Rows t, seq;
  std::vector<Rows> fields;
  std::vector<std::vector<std::string>> texts;

  std::size_t bytes() const {
    std::size_t numbers = t.values.size() + seq.values.size();
    for (const Rows& f : fields) numbers += f.values.size();
    return numbers * sizeof(double);
  }
};

matvar_t* matrix(const Rows& rows) {
  std::size_t dims[2] = {rows.rows, rows.width};
  std::vector<double> columns = rows.by_column();
  return Mat_VarCreate(nullptr, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims, columns.data(), 0);
}

matvar_t* cells(std::vector<std::string> texts) {
  std::size_t dims[2] = {texts.size(), 1};
  matvar_t* cell = Mat_VarCreate(nullptr, MAT_C_CELL, MAT_T_CELL, 2, dims, nullptr, 0);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    std::size_t length[2] = {texts[i].empty() ? std::size_t{0} : std::size_t{1}, texts[i].size()};
    Mat_VarSetCell(cell, static_cast<int>(i),
                   Mat_VarCreate(nullptr, MAT_C_CHAR, MAT_T_UINT8, 2, length, texts[i].data(), 0));
  }
  return cell;
}

class MatSink final : public ExportSink {
 public:
  explicit MatSink(const std::string& path) : path_(path), part_(path) {}
  void open(const std::string& stream, const Layout& layout) override {
    streams_.push_back({.name = stream,
                        .layout = layout,
                        .t = {.width = 1},
                        .seq = {.width = 1},
                        .fields = std::vector<Rows>(layout.numbers.size()),
                        .texts = std::vector<std::vector<std::string>>(layout.texts.size())});
  }
  void write(std::size_t stream, const Sample& sample) override {
    Stream& s = streams_[stream];
    const double t = static_cast<double>(sample.t_ns) / 1e9, seq = static_cast<double>(sample.k);
    s.t.add(&t, 1);
    s.seq.add(&seq, 1);
    const double* numbers = sample.numbers.data();
    for (std::size_t f = 0; f < s.fields.size(); numbers += sample.counts[f++])
      s.fields[f].add(numbers, sample.counts[f]);
    for (std::size_t f = 0; f < s.texts.size(); ++f) s.texts[f].push_back(sample.texts[f]);
  }
  void finish() override {
    for (const Stream& s : streams_)
      if (s.bytes() > kMaxVariableBytes)
        throw BadInput(fmt::format(
            "{}: {} takes {} MB, a MAT 5 file holds 2147 MB of a struct; fewer --channels, --from "
            "and --to, --resample or --format mcap",
            path_, s.name, s.bytes() / 1000000));
    mat_t* file = Mat_CreateVer(part_.part_path().c_str(), nullptr, MAT_FT_MAT5);
    if (!file) part_.fail();
    bool written = true;
    for (const Stream& s : streams_) written = written && put(file, s);
    if (Mat_Close(file) != 0 || !written) part_.fail();
    part_.finish();
  }

 private:
  static bool put(mat_t* file, const Stream& s) {
    std::vector<const char*> names = {"t", "seq"};
    for (const Field& f : s.layout.numbers) names.push_back(f.name.c_str());
    for (const std::string& text : s.layout.texts) names.push_back(text.c_str());
    std::size_t dims[2] = {1, 1};
    matvar_t* all = Mat_VarCreateStruct(s.name.c_str(), 2, dims, names.data(),
                                        static_cast<unsigned>(names.size()));
    Mat_VarSetStructFieldByName(all, "t", 0, matrix(s.t));
    Mat_VarSetStructFieldByName(all, "seq", 0, matrix(s.seq));
    for (std::size_t f = 0; f < s.fields.size(); ++f)
      Mat_VarSetStructFieldByName(all, s.layout.numbers[f].name.c_str(), 0, matrix(s.fields[f]));
    for (std::size_t f = 0; f < s.texts.size(); ++f)
      Mat_VarSetStructFieldByName(all, s.layout.texts[f].c_str(), 0, cells(s.texts[f]));
    const bool written = Mat_VarWrite(file, all, MAT_COMPRESSION_NONE) == 0;
    Mat_VarFree(all);
    return written;
  }

  std::string path_;
  PartFile part_;
  std::vector<Stream> streams_;
};

}  // namespace

std::unique_ptr<ExportSink> make_mat_sink(const std::string& path) {
  return std::make_unique<MatSink>(path);
}

}  // namespace twinrate

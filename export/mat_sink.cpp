#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "core/config.hpp"
#include "core/load_part.hpp"
#include "core/output_file.hpp"
#include "export/matio_functions.hpp"
#include "export/sink.hpp"

namespace twinrate {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMaxVariableBytes = std::numeric_limits<std::int32_t>::max();  // MAT 5

constexpr std::int64_t kMaxExact = std::int64_t{1} << 53;  // whole numbers of a double

// All samples of one field, row by row; the row width is that of the longest array.
template <class Number>
struct Rows {
  std::size_t width = 0, rows = 0;
  std::vector<Number> values = {};

  void add(const Number* numbers, std::size_t count) {
    if (count > width) widen(count);
    values.insert(values.end(), numbers, numbers + count);
    values.resize(values.size() + width - count, none());
    ++rows;
  }
  static Number none() {
    if constexpr (std::is_same_v<Number, double>) return kNone;
    return {};
  }
  void widen(std::size_t to) {
    std::vector<Number> wider(rows * to, none());
    for (std::size_t r = 0; r < rows; ++r)
      std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(r * width), width,
                  wider.begin() + static_cast<std::ptrdiff_t>(r * to));
    values = std::move(wider);
    width = to;
  }
  template <class As>
  std::vector<As> by_column() const {
    std::vector<As> columns(values.size());
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t c = 0; c < width; ++c)
        columns[c * rows + r] = static_cast<As>(values[r * width + c]);
    return columns;
  }
};
using Wholes = Rows<std::int64_t>;

struct Stream {
  std::string name;
  Layout layout;
  Rows<double> t;
  std::array<Wholes, 6> origin;       // kOrigin
  std::vector<Rows<double>> numbers;  // of each field; empty for a whole one
  std::vector<Wholes> wholes;         // likewise
  std::vector<std::vector<std::string>> texts;

  std::size_t bytes() const {
    std::size_t count = t.values.size();
    for (const Wholes& w : origin) count += w.values.size();
    for (const Rows<double>& f : numbers) count += f.values.size();
    for (const Wholes& w : wholes) count += w.values.size();
    return count * sizeof(double);
  }
};
constexpr const char* kOrigin[] = {"seq", "t_ns", "session", "tag", "timestamp_us", "event"};

const MatioFunctions& matio() {
  static const auto* const functions = static_cast<const MatioFunctions*>(load_part("matio"));
  return *functions;
}

matvar_t* matrix(const Rows<double>& rows) {
  std::size_t dims[2] = {rows.rows, rows.width};
  std::vector<double> columns = rows.by_column<double>();
  return matio().variable(nullptr, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims, columns.data(), 0);
}

matvar_t* matrix(const Wholes& rows) {
  std::size_t dims[2] = {rows.rows, rows.width};
  const bool exact = std::all_of(rows.values.begin(), rows.values.end(), [](std::int64_t value) {
    return value <= kMaxExact && value >= -kMaxExact;
  });
  if (exact) {
    std::vector<double> columns = rows.by_column<double>();
    return matio().variable(nullptr, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims, columns.data(), 0);
  }
  std::vector<std::int64_t> columns = rows.by_column<std::int64_t>();
  return matio().variable(nullptr, MAT_C_INT64, MAT_T_INT64, 2, dims, columns.data(), 0);
}

matvar_t* cells(std::vector<std::string> texts) {
  std::size_t dims[2] = {texts.size(), 1};
  matvar_t* cell = matio().variable(nullptr, MAT_C_CELL, MAT_T_CELL, 2, dims, nullptr, 0);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    std::size_t length[2] = {texts[i].empty() ? std::size_t{0} : std::size_t{1}, texts[i].size()};
    matio().set_cell(
        cell, static_cast<int>(i),
        matio().variable(nullptr, MAT_C_CHAR, MAT_T_UINT8, 2, length, texts[i].data(), 0));
  }
  return cell;
}

class MatSink final : public ExportSink {
 public:
  explicit MatSink(const std::string& path) : path_(path), part_(path) { matio(); }
  void open(const std::string& stream, const Layout& layout) override {
    streams_.push_back({.name = stream,
                        .layout = layout,
                        .t = {.width = 1},
                        .origin = {},
                        .numbers = std::vector<Rows<double>>(layout.numbers.size()),
                        .wholes = std::vector<Wholes>(layout.numbers.size()),
                        .texts = std::vector<std::vector<std::string>>(layout.texts.size())});
  }
  void write(std::size_t stream, const Sample& sample) override {
    Stream& s = streams_[stream];
    const double t = static_cast<double>(sample.t_ns) / 1e9;
    s.t.add(&t, 1);
    const std::int64_t origin[] = {sample.k,
                                   sample.t_ns,
                                   sample.origin.session,
                                   sample.origin.tag,
                                   sample.origin.timestamp_us,
                                   sample.origin.event};
    for (std::size_t i = 0; i < s.origin.size(); ++i) s.origin[i].add(&origin[i], 1);
    std::size_t at = 0;
    for (std::size_t f = 0; f < s.numbers.size(); at += sample.counts[f++]) {
      if (s.layout.numbers[f].whole)
        s.wholes[f].add(&sample.wholes[at], sample.counts[f]);
      else
        s.numbers[f].add(&sample.numbers[at], sample.counts[f]);
    }
    for (std::size_t f = 0; f < s.texts.size(); ++f) s.texts[f].push_back(sample.texts[f]);
  }
  void finish() override {
    for (const Stream& s : streams_)
      if (s.bytes() > kMaxVariableBytes)
        throw BadInput(fmt::format(
            "{}: {} takes {} MB, a MAT 5 file holds 2147 MB of a struct; fewer --channels, --from "
            "and --to, --resample or --format mcap",
            path_, s.name, s.bytes() / 1000000));
    mat_t* file = matio().create(part_.part_path().c_str(), nullptr, MAT_FT_MAT5);
    if (!file) part_.fail();
    bool written = true;
    for (const Stream& s : streams_) written = written && put(file, s);
    if (matio().close(file) != 0 || !written) part_.fail();
    expect_whole(part_.part_path());
    part_.finish();
  }

 private:
  // matio ignores the result of fwrite: on a full disk the file is truncated. Its elements, each
  // with 8 bytes and its length, must end where the file ends.
  void expect_whole(const std::string& path) const {
    constexpr std::streamoff kHeaderBytes = 128;
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    const std::streamoff bytes = file.tellg();
    std::streamoff at = kHeaderBytes;
    std::size_t elements = 0;
    while (file && at < bytes) {
      std::uint32_t tag[2] = {0, 0};  // type and length, in the order of this machine
      file.seekg(at).read(reinterpret_cast<char*>(tag), sizeof tag);
      at += static_cast<std::streamoff>(sizeof tag) + tag[1];
      ++elements;
    }
    if (!file || at != bytes || elements != streams_.size())
      throw std::runtime_error(
          fmt::format("{}: cannot be written whole: is the disk full?", path_));
  }
  static bool put(mat_t* file, const Stream& s) {
    std::vector<const char*> names = {"t"};
    names.insert(names.end(), std::begin(kOrigin), std::end(kOrigin));
    for (const Field& f : s.layout.numbers) names.push_back(f.name.c_str());
    for (const std::string& text : s.layout.texts) names.push_back(text.c_str());
    std::size_t dims[2] = {1, 1};
    matvar_t* all = matio().structure(s.name.c_str(), 2, dims, names.data(),
                                      static_cast<unsigned>(names.size()));
    matio().set_field(all, "t", 0, matrix(s.t));
    for (std::size_t i = 0; i < s.origin.size(); ++i)
      matio().set_field(all, kOrigin[i], 0, matrix(s.origin[i]));
    for (std::size_t f = 0; f < s.numbers.size(); ++f)
      matio().set_field(all, s.layout.numbers[f].name.c_str(), 0,
                        s.layout.numbers[f].whole ? matrix(s.wholes[f]) : matrix(s.numbers[f]));
    for (std::size_t f = 0; f < s.texts.size(); ++f)
      matio().set_field(all, s.layout.texts[f].c_str(), 0, cells(s.texts[f]));
    const bool written = matio().write(file, all, MAT_COMPRESSION_NONE) == 0;
    matio().free(all);
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

#include <fmt/format.h>
#include <zlib.h>

#include <cmath>
#include <iterator>

#include "core/output_file.hpp"
#include "export/sink.hpp"

namespace twinrate {

namespace {

class CsvSink final : public ExportSink {
 public:
  explicit CsvSink(const std::string& path)
      : part_(path),
        file_(gzopen(part_.part_path().c_str(), path.ends_with(".gz") ? "wb" : "wbT")) {
    if (!file_) part_.fail();
    gzbuffer(file_, 1 << 17);
  }
  ~CsvSink() override {
    if (file_) gzclose(file_);
  }
  void open(const std::string&, const Layout& layout) override {
    line_.assign(1, 't');
    whole_.clear();
    for (const Field& f : layout.numbers) {
      line_.append(1, ',').append(f.name);
      whole_.push_back(f.whole);
    }
    put_line();
  }
  void write(std::size_t, const Sample& sample) override {
    line_.clear();
    fmt::format_to(std::back_inserter(line_), "{}", static_cast<double>(sample.t_ns) / 1e9);
    for (std::size_t i = 0; i < sample.numbers.size(); ++i) {
      line_ += ',';
      if (std::isnan(sample.numbers[i])) continue;
      if (whole_[i])
        fmt::format_to(std::back_inserter(line_), "{}", sample.wholes[i]);
      else
        fmt::format_to(std::back_inserter(line_), "{}", sample.numbers[i]);
    }
    put_line();
  }
  void finish() override {
    const int result = gzclose(file_);
    file_ = nullptr;
    if (result != Z_OK) part_.fail();
    part_.finish();
  }

 private:
  void put_line() {
    line_ += '\n';
    if (gzwrite(file_, line_.data(), static_cast<unsigned>(line_.size())) !=
        static_cast<int>(line_.size()))
      part_.fail();
  }
  PartFile part_;
  gzFile file_;
  std::string line_;
  std::vector<bool> whole_;  // of each column
};

}  // namespace

std::unique_ptr<ExportSink> make_csv_sink(const std::string& path) {
  return std::make_unique<CsvSink>(path);
}

}  // namespace twinrate

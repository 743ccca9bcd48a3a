#include <fmt/format.h>
#include <zlib.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iterator>

#include "core/config.hpp"
#include "export/sink.hpp"

namespace twinrate {

PartFile::PartFile(const std::string& path) : path_(path), part_path_(path + ".part") {
  // A rename would replace a device or directory.
  if (std::filesystem::exists(path) && !std::filesystem::is_regular_file(path))
    throw BadInput(fmt::format("{}: is not a plain file; give a file name", path));
  std::FILE* file = std::fopen(part_path_.c_str(), "wb");
  if (!file) throw BadInput(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
  std::fclose(file);
}

PartFile::~PartFile() {
  if (!done_) std::remove(part_path_.c_str());
}

void PartFile::finish() {
  if (std::rename(part_path_.c_str(), path_.c_str()) != 0) fail();
  done_ = true;
}

void PartFile::fail() const {
  throw std::runtime_error(fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
}

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
    for (const Field& f : layout.numbers) line_.append(1, ',').append(f.name);
    put_line();
  }
  void write(std::size_t, const Sample& sample) override {
    line_.clear();
    fmt::format_to(std::back_inserter(line_), "{}", static_cast<double>(sample.t_ns) / 1e9);
    for (const double value : sample.numbers) {
      line_ += ',';
      if (!std::isnan(value)) fmt::format_to(std::back_inserter(line_), "{}", value);
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
};

}  // namespace

std::unique_ptr<ExportSink> make_csv_sink(const std::string& path) {
  return std::make_unique<CsvSink>(path);
}

}  // namespace twinrate

#include "import/text_source.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <zlib.h>

#include <algorithm>

#include "core/config.hpp"
#include "import/mat_file.hpp"

namespace twinrate {
namespace {

constexpr unsigned kReadBytes = 1 << 18;

// Throws BadInput if the file does not exist.
std::int64_t size_of_file(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) throw BadInput(fmt::format("{}: no such file", path));
  if (S_ISDIR(info.st_mode))
    throw BadInput(fmt::format("{}: is a directory; a file is needed", path));
  if (!S_ISREG(info.st_mode)) throw BadInput(fmt::format("{}: is not a plain file", path));
  return info.st_size;
}

class GzText final : public TextSource {
 public:
  explicit GzText(const std::string& path)
      : path_(path), bytes_stored_(size_of_file(path)), file_(gzopen(path.c_str(), "rb")) {
    if (!file_) throw BadInput(fmt::format("{}: cannot be read", path));
    gzbuffer(file_, kReadBytes);
  }
  ~GzText() override { gzclose(file_); }
  GzText(const GzText&) = delete;
  GzText& operator=(const GzText&) = delete;

  int read(char* to, unsigned size) override {
    const int got = gzread(file_, to, size);
    if (got > 0) return got;
    int error = Z_OK;
    const char* what = gzerror(file_, &error);
    if (error != Z_OK && error != Z_BUF_ERROR && error != Z_STREAM_END)
      throw BadInput(fmt::format("{}; the file cannot be unpacked", what));  // names the file
    cut_off_ = error == Z_BUF_ERROR;
    return 0;
  }
  void seek(std::int64_t byte) override {
    if (gzseek(file_, static_cast<z_off_t>(byte), SEEK_SET) < 0)
      throw BadInput(fmt::format("{}: cannot be read again; the file has changed", path_));
    cut_off_ = false;
  }
  double share_read() const override {
    const auto bytes = static_cast<double>(gzoffset(file_));
    return bytes_stored_ == 0 ? 1.0 : std::min(1.0, bytes / static_cast<double>(bytes_stored_));
  }
  bool cut_off() const override { return cut_off_; }

 private:
  std::string path_;
  std::int64_t bytes_stored_;
  gzFile file_;
  bool cut_off_ = false;
};

// A header line and a line of equal length a row: the place of a row is known without reading.
class MatText final : public TextSource {
 public:
  explicit MatText(const std::string& path) : table_(read_mat_table(path)) {
    for (const MatColumn& column : table_.columns)
      header_ += (header_.empty() ? "" : ",") + column.name;
    header_ += '\n';
  }
  int read(char* to, unsigned size) override {
    std::size_t done = 0;
    while (done < size && at_ < bytes()) {
      const bool head = at_ < header_.size();
      const std::size_t row = head ? 0 : (at_ - header_.size()) / line_bytes(),
                        skipped = head ? at_ : (at_ - header_.size()) % line_bytes();
      const std::string line = head ? header_ : line_of(row);
      const std::size_t take = std::min(line.size() - skipped, size - done);
      std::copy_n(line.data() + skipped, take, to + done);
      done += take;
      at_ += take;
    }
    return static_cast<int>(done);
  }
  void seek(std::int64_t byte) override { at_ = static_cast<std::size_t>(byte); }
  double share_read() const override {
    return static_cast<double>(at_) / static_cast<double>(bytes());
  }
  bool cut_off() const override { return false; }

 private:
  static constexpr std::size_t kCell = 25;  // of a number with all digits, with its separator

  std::size_t line_bytes() const { return kCell * table_.columns.size(); }
  std::size_t bytes() const { return header_.size() + table_.rows * line_bytes(); }
  std::string line_of(std::size_t row) const {
    std::string line;
    for (const MatColumn& column : table_.columns)
      line += fmt::format("{:>24},", fmt::format("{}", column.values[row]));
    line.back() = '\n';
    return line;
  }

  MatTable table_;
  std::string header_;
  std::size_t at_ = 0;
};

}  // namespace

std::unique_ptr<TextSource> open_text(const std::string& path) {
  size_of_file(path);
  if (path.ends_with(".mat")) return std::make_unique<MatText>(path);
  return std::make_unique<GzText>(path);
}

}  // namespace twinrate

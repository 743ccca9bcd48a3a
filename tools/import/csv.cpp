#include "tools/import/csv.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <memory>

#include "core/config.hpp"

namespace twinrate {
namespace {

constexpr std::string_view kBlanks = " \t\r";

std::string_view trimmed(std::string_view text) {
  const auto begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  text = text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"')
    text = text.substr(1, text.size() - 2);
  return text;
}

bool is_regular_file(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode);
}

}  // namespace

CsvReader::CsvReader(const std::string& path, const CsvFormat& format)
    : path_(path), format_(format) {
  load();
  if (text_.starts_with("\xEF\xBB\xBF")) position_ = 3;
  std::string_view skipped;
  for (int i = 0; i < format_.skip; ++i) take_line(skipped);
  find_next();
  if (!format_.header) return;
  std::vector<std::string_view> names;
  if (!next(names))
    throw BadInput(fmt::format("{}:1: no header line; a row of column names is needed", path_));
  header_.assign(names.begin(), names.end());
  header_line_ = line_;
}

void CsvReader::load() {
  if (!is_regular_file(path_)) throw BadInput(fmt::format("{}: no such file", path_));
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path_.c_str(), "rb"), gzclose);
  if (!file) throw BadInput(fmt::format("{}: cannot be read", path_));
  gzbuffer(file.get(), 1 << 18);
  constexpr unsigned kBlock = 1 << 20;
  for (int got = 1; got > 0;) {
    const std::size_t size = text_.size();
    text_.resize(size + kBlock);
    got = gzread(file.get(), text_.data() + size, kBlock);
    text_.resize(size + static_cast<std::size_t>(std::max(got, 0)));
  }
  int error = Z_OK;
  const char* what = gzerror(file.get(), &error);
  if (error != Z_OK && error != Z_BUF_ERROR && error != Z_STREAM_END)
    throw BadInput(fmt::format("{}; the file cannot be unpacked", what));  // names the file
  cut_off_ = error == Z_BUF_ERROR || (!text_.empty() && text_.back() != '\n');
}

bool CsvReader::take_line(std::string_view& line) {
  if (position_ >= text_.size()) return false;
  const auto end = std::min(text_.find('\n', position_), text_.size());
  line = std::string_view(text_).substr(position_, end - position_);
  position_ = end + 1;
  ++lines_taken_;
  return true;
}

void CsvReader::find_next() {
  std::string_view line;
  while (take_line(line)) {
    if (line.find_first_not_of(kBlanks) == std::string_view::npos) continue;
    if (!format_.comment.empty() && line.starts_with(format_.comment)) continue;
    next_ = line;
    next_line_ = lines_taken_;
    return;
  }
  next_ = {};
}

bool CsvReader::next(std::vector<std::string_view>& fields) {
  if (at_end()) return false;
  split(next_, fields);
  line_ = next_line_;
  find_next();
  return true;
}

void CsvReader::split(std::string_view line, std::vector<std::string_view>& fields) const {
  fields.clear();
  const bool blanks = format_.separator == ' ';
  if (blanks) {
    const auto first = line.find_first_not_of(kBlanks);
    line.remove_prefix(std::min(first, line.size()));
    line = line.substr(0, line.find_last_not_of(kBlanks) + 1);
  }
  while (true) {
    const auto end = blanks ? line.find_first_of(kBlanks) : line.find(format_.separator);
    fields.push_back(trimmed(line.substr(0, end)));
    if (end == std::string_view::npos) return;
    line.remove_prefix(end + 1);
    if (blanks) line.remove_prefix(std::min(line.find_first_not_of(kBlanks), line.size()));
  }
}

double CsvReader::share_read() const {
  return text_.empty()
             ? 1.0
             : std::min(1.0, static_cast<double>(position_) / static_cast<double>(text_.size()));
}

std::string file_hash(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  std::vector<char> block(1 << 20);
  while (in.read(block.data(), static_cast<std::streamsize>(block.size())) || in.gcount() > 0)
    for (std::streamsize i = 0; i < in.gcount(); ++i)
      hash = (hash ^ static_cast<unsigned char>(block[static_cast<std::size_t>(i)])) *
             0x100000001b3ULL;
  return fmt::format("{:016x}", hash);
}

}  // namespace twinrate

#include "import/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>

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

constexpr unsigned kBlockBytes = 1 << 18;
constexpr std::size_t kMaxLineBytes = 1 << 20;

std::string quoted(char separator) {
  return separator == '\t' ? "\\t" : std::string(1, separator);
}

}  // namespace

CsvReader::CsvReader(const std::string& path, const CsvFormat& format)
    : path_(path), format_(format), text_(open_text(path)) {
  fill();
  if (block_.starts_with("\xEF\xBB\xBF")) position_ = 3;
  std::string_view skipped;
  for (int i = 0; i < format_.skip; ++i) take_line(skipped);
  find_next();
  if (!format_.header) return;
  std::vector<std::string_view> names;
  if (!next(names))
    throw BadInput(fmt::format("{}:1: no header line; a row of column names is required", path_));
  header_.assign(names.begin(), names.end());
  header_line_ = line_;
  expect_separated();
}

// Throws BadInput if a header of one column holds another separator.
void CsvReader::expect_separated() const {
  if (header_.size() != 1) return;
  for (const char other : {';', '\t', '|'})
    if (other != format_.separator && header_[0].find(other) != std::string::npos)
      throw BadInput(fmt::format(
          "{}:{}: the columns are separated by \"{}\", \"{}\" is expected; a map (--map) with "
          "[file] separator = \"{}\" reads such a file (decimal = \",\" where numbers have that)",
          path_, header_line_, quoted(other), quoted(format_.separator), quoted(other)));
}

bool CsvReader::fill() {
  if (ended_) return false;
  block_begin_ += static_cast<std::int64_t>(position_);
  block_.erase(0, position_);
  position_ = 0;
  const std::size_t kept = block_.size();
  block_.resize(kept + kBlockBytes);
  const int got = text_->read(block_.data() + kept, kBlockBytes);
  block_.resize(kept + static_cast<std::size_t>(got));
  if (got > 0) return true;
  ended_ = true;
  cut_off_ = text_->cut_off() || (!block_.empty() && block_.back() != '\n');
  return false;
}

bool CsvReader::take_line(std::string_view& line) {
  std::size_t end = block_.find('\n', position_);
  while (end == std::string::npos) {
    const std::size_t looked_at = block_.size() - position_;
    if (looked_at > kMaxLineBytes)
      throw BadInput(fmt::format("{}:{}: the line is longer than {} MB; not a table of text", path_,
                                 lines_taken_ + 1, kMaxLineBytes >> 20));
    if (!fill()) break;
    end = block_.find('\n', position_ + looked_at);
  }
  if (position_ >= block_.size()) return false;
  end = std::min(end, block_.size());
  line = std::string_view(block_).substr(position_, end - position_);
  position_ = std::min(end + 1, block_.size());
  ++lines_taken_;
  return true;
}

void CsvReader::find_next() {
  std::string_view line;
  Place place{block_begin_ + static_cast<std::int64_t>(position_), lines_taken_};
  for (has_next_ = false; take_line(line); place.lines_before = lines_taken_) {
    const bool comment = !format_.comment.empty() && line.starts_with(format_.comment);
    has_next_ = !comment && line.find_first_not_of(kBlanks) != std::string_view::npos;
    if (has_next_) break;
    place.byte = block_begin_ + static_cast<std::int64_t>(position_);
  }
  next_.assign(has_next_ ? line : std::string_view());
  next_line_ = lines_taken_;
  next_place_ = place;
}

bool CsvReader::next(std::vector<std::string_view>& fields) {
  if (at_end()) return false;
  current_.swap(next_);
  split(current_, fields);
  line_ = next_line_;
  find_next();
  return true;
}

void CsvReader::go_to(const Place& place) {
  text_->seek(place.byte);
  block_.clear();
  position_ = 0;
  block_begin_ = place.byte;
  ended_ = cut_off_ = false;
  lines_taken_ = place.lines_before;
  find_next();
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
  return ended_ ? 1.0 : text_->share_read();
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

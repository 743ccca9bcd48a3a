#include "import/text_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include "core/config.hpp"
#include "import/guess_names.hpp"
#include "import/text_source.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kLookBytes = 1 << 18;
constexpr std::size_t kRowsInARow = 3;  // of numbers, the same count: these are the data

std::string first_text(const std::string& path) {
  const auto source = open_text(path);
  std::string text(kLookBytes, '\0');
  std::size_t done = 0;
  while (done < text.size()) {
    const int got = source->read(text.data() + done, static_cast<unsigned>(text.size() - done));
    if (got <= 0) break;
    done += static_cast<std::size_t>(got);
  }
  text.resize(done);
  if (done == kLookBytes) text.resize(std::min(text.rfind('\n'), text.size() - 1) + 1);
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  return text;
}

// Length of the UTF-8 character at `at`; 0 if there is none.
std::size_t utf8_length(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(at);
  const std::size_t length = first < 0x80                    ? 1
                             : first >= 0xC2 && first < 0xE0 ? 2
                             : first >= 0xE0 && first < 0xF0 ? 3
                             : first >= 0xF0 && first < 0xF5 ? 4
                                                             : 0;
  if (length == 0 || at + length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte(at + i) & 0xC0) != 0x80) return 0;
  return length;
}

// A name for people and for the map, which is UTF-8. Other bytes are those of Latin 1.
std::string utf8(const std::string& text) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = utf8_length(text, at);
    if (length > 0) {
      out += text.substr(at, length);
      at += length;
      continue;
    }
    const auto byte = static_cast<unsigned char>(text[at++]);
    out += static_cast<char>(0xC0 | byte >> 6);
    out += static_cast<char>(0x80 | (byte & 0x3F));
  }
  return out;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines(1);
  for (const char c : text)
    if (c == '\n')
      lines.emplace_back();
    else if (c != '\r')
      lines.back() += c;
  return lines;
}

std::string without_blanks(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\""), end = text.find_last_not_of(" \t\"");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

std::vector<std::string> fields_of(const std::string& line, char separator) {
  std::vector<std::string> fields;
  if (separator == ' ') {
    for (std::size_t at = line.find_first_not_of(" \t"); at != std::string::npos;) {
      const std::size_t end = std::min(line.find_first_of(" \t", at), line.size());
      fields.push_back(without_blanks(line.substr(at, end - at)));
      at = line.find_first_not_of(" \t", end);
    }
    return fields;
  }
  for (std::size_t at = 0;;) {
    const std::size_t end = line.find(separator, at);
    fields.push_back(without_blanks(line.substr(at, end - at)));
    if (end == std::string::npos) return fields;
    at = end + 1;
  }
}

std::optional<double> number_of(std::string text, char decimal) {
  if (decimal == ',') std::replace(text.begin(), text.end(), ',', '.');
  if (text.starts_with('+')) text.erase(0, 1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

// First run of kRowsInARow rows with one count of fields, most of them numbers.
std::optional<Layout> layout_of(const std::vector<std::string>& lines, char separator,
                                char decimal) {
  Layout layout{.separator = separator, .decimal = decimal};
  std::size_t run = 0;
  for (std::size_t i = 0; i < lines.size() && run < kRowsInARow; ++i) {
    if (without_blanks(lines[i]).empty()) continue;
    const auto fields = fields_of(lines[i], separator);
    const auto count = static_cast<std::size_t>(
        std::count_if(fields.begin(), fields.end(),
                      [&](const std::string& f) { return number_of(f, decimal).has_value(); }));
    const auto empty =
        static_cast<std::size_t>(std::count(fields.begin(), fields.end(), std::string()));
    const bool row = count >= 2 && 5 * count >= 3 * (fields.size() - empty);
    if (!row || (run > 0 && fields.size() != layout.fields)) run = 0;
    if (!row) continue;
    if (run++ == 0) {
      layout.data_line = i;
      layout.fields = fields.size();
      layout.numbers = count;
    }
  }
  if (run < kRowsInARow) return {};
  return layout;
}

std::string without_comment(std::string line) {
  while (!line.empty() && (line[0] == '#' || line[0] == '%' || line[0] == '/' || line[0] == ' '))
    line.erase(0, 1);
  return line;
}

bool is_units_row(const std::vector<std::string>& fields) {
  std::size_t units = 0, filled = 0;
  for (const std::string& field : fields) {
    if (field.empty()) continue;
    ++filled;
    std::string text = field;
    if ((text.front() == '(' && text.back() == ')') || (text.front() == '[' && text.back() == ']'))
      text = text.substr(1, text.size() - 2);
    units += unit_of(text).has_value() || text == "-" || text.empty();
  }
  return filled > 0 && 2 * units > filled;
}

}  // namespace

std::vector<std::string> first_lines(const std::string& path) {
  return lines_of(first_text(path));
}

Layout best_layout(const std::string& path, const std::vector<std::string>& lines) {
  std::optional<Layout> best;
  for (const char separator : {';', '\t', ',', '|', ' '})
    for (const char decimal : {'.', ','}) {
      if (separator == decimal) continue;
      const auto layout = layout_of(lines, separator, decimal);
      if (layout && (!best || layout->numbers > best->numbers)) best = layout;
    }
  if (!best)
    throw BadInput(
        fmt::format("{}:1: no table in the first {} lines: {} rows of two or more numbers needed",
                    path, lines.size(), kRowsInARow));
  return *best;
}

Values values_of(const std::vector<std::string>& lines, const Layout& layout, std::size_t column) {
  Values values;
  for (std::size_t i = layout.data_line; i < lines.size(); ++i) {
    const auto fields = fields_of(lines[i], layout.separator);
    if (column >= fields.size()) continue;
    const auto number = number_of(fields[column], layout.decimal);
    if (!number) continue;
    values.x.push_back(*number);
    const std::size_t point = fields[column].find(layout.decimal),
                      end = std::min(fields[column].find_first_of("eE"), fields[column].size());
    if (point != std::string::npos && point < end)
      values.decimals = std::max(values.decimals, static_cast<int>(end - point - 1));
  }
  return values;
}

Header header_of(const std::vector<std::string>& lines, const Layout& layout) {
  Header header{.names = std::vector<std::string>(layout.fields),
                .units = std::vector<std::string>(layout.fields)};
  std::vector<std::size_t> above;  // lines with this number of fields, the closest first
  for (std::size_t i = layout.data_line; i-- > 0 && above.size() < 2;) {
    if (without_blanks(lines[i]).empty()) continue;
    const std::size_t count = fields_of(without_comment(lines[i]), layout.separator).size();
    if (count != layout.fields && count + 1 != layout.fields) break;
    above.push_back(i);
  }
  const auto take = [&](std::size_t line, std::vector<std::string>& to) {
    to = fields_of(without_comment(lines[line]), layout.separator);
    to.resize(layout.fields);
  };
  header.by_number = true;
  header.skip = layout.data_line;
  if (above.empty()) return header;
  take(above[0], header.names);
  if (above.size() == 2 && is_units_row(header.names)) {
    header.units = header.names;
    for (std::string& unit : header.units)
      if (unit.size() > 2 && (unit.front() == '(' || unit.front() == '['))
        unit = unit.substr(1, unit.size() - 2);
    take(above[1], header.names);
  } else if (lines[above[0]] == without_comment(lines[above[0]]) ||
             lines[above[0]].starts_with(' ')) {
    header.by_number = false;
    header.skip = above[0];
  }
  return header;
}

bool make_utf8(Header& header) {
  bool changed = false;
  for (auto* texts : {&header.names, &header.units})
    for (std::string& text : *texts) {
      std::string whole = utf8(text);
      changed = changed || whole != text;
      text = std::move(whole);
    }
  return changed;
}

}  // namespace twinrate

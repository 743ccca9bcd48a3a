#include "import/guess.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>

#include "core/config.hpp"
#include "import/guess_names.hpp"
#include "import/text_source.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kLookBytes = 1 << 18;
constexpr std::size_t kRowsInARow = 3;  // of numbers, the same count: these are the data
// Without a unit. Larger values, or values with fewer decimals, may be milliamperes or counts.
constexpr double kMax_A = 50, kMax_V = 1000;
constexpr int kMinDecimals = 3;
// Without a unit: in ms these spacings would be 1 ns to 20 us.
constexpr double kMinStep_s = 1e-6, kMaxStep_s = 0.02;

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

struct Layout {
  char separator = ',', decimal = '.';
  std::size_t data_line = 0, fields = 0, numbers = 0;  // numbers: fields that are numbers
};

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

// Values of the first rows.
struct Values {
  std::vector<double> x;
  int decimals = 0;  // most digits behind the decimal point

  double max_abs() const {
    double max = 0;
    for (const double v : x) max = std::max(max, std::abs(v));
    return max;
  }
  double median_step() const {
    std::vector<double> steps;
    for (std::size_t i = 1; i < x.size(); ++i) steps.push_back(x[i] - x[i - 1]);
    if (steps.empty()) return 0;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return *middle;
  }
  // The values fill 0 to `turn` (or -turn/2 to turn/2) and jump back by almost a turn.
  bool restarts_at(double turn) const {
    if (x.empty()) return false;
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    bool jump = false;
    for (std::size_t i = 1; i < x.size(); ++i)
      jump = jump || std::abs(x[i] - x[i - 1]) > 0.8 * turn;
    const double range = *high - *low;
    return jump && range > 0.9 * turn && range <= 1.001 * turn;
  }
};

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

struct Header {
  std::vector<std::string> names, units;
  bool by_number = false;
  std::size_t skip = 0;
};

Header header_of(const std::vector<std::string>& lines, const Layout& layout) {
  Header header{.names = std::vector<std::string>(layout.fields),
                .units = std::vector<std::string>(layout.fields)};
  std::vector<std::size_t> above;  // lines of as many fields, the nearest first
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

// The map is UTF-8, the names of the file are not: the map then has the numbers of the columns.
bool made_utf8(Header& header) {
  bool changed = false;
  for (auto* texts : {&header.names, &header.units})
    for (std::string& text : *texts) {
      std::string whole = utf8(text);
      changed = changed || whole != text;
      text = std::move(whole);
    }
  return changed;
}

std::string tool_of(const std::vector<std::string>& names) {
  const auto has = [&](const char* name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  const auto any = [&](const char* part) {
    return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
      return name.find(part) != std::string::npos;
    });
  };
  if (has("ms_today") && has("erpm")) return "vesc";
  if (any("servo_stats.")) return "moteus";
  if (any(".Iq_measured") || any("pos_vel_mapper.") || any("encoder.pos_estimate")) return "odrive";
  if (has("target") && has("voltage_q") && has("velocity")) return "simplefoc";
  return "";
}

const ToolColumn* tool_column(const std::string& tool, const std::string& name) {
  for (const ToolColumn& column : tool_columns())
    if (tool == column.tool &&
        (name == column.name || name.ends_with(std::string(".") + column.name)))
      return &column;
  return nullptr;
}

class Guesser {
 public:
  Guesser(const GuessRequest& request, Guess& guess, const std::vector<std::string>& lines,
          const Layout& layout, const Header& header)
      : request_(request), guess_(guess), lines_(lines), layout_(layout), header_(header) {
    for (const std::string& name : header.names) bare_names_.push_back(named_unit(name).name);
    // A header of canonical names, perhaps with columns of others between them.
    const auto canonical = std::count_if(header.names.begin(), header.names.end(), is_canonical);
    drive_log_ = has_name("t") && 2 * static_cast<std::size_t>(canonical) >= header.names.size();
  }

  GuessedColumn column(std::size_t i) const {
    GuessedColumn c{.name = header_.names[i], .number = static_cast<int>(i) + 1};
    if (c.name.empty()) {
      c.reason = "has no name";
      return c;
    }
    if (drive_log_ && is_canonical(c.name)) {
      c.canonical = c.name;
      c.unit_from = "the name of a drive log, SI";
      return c;
    }
    NamedUnit named = named_unit(c.name);
    if (c.name.ends_with("_A") && has_name(c.name.substr(0, c.name.size() - 1) + "B"))
      named = {c.name, ""};  // phase A beside phase B
    if (!header_.units[i].empty()) named = {c.name, header_.units[i]};
    if (named.unit.empty() && plain(named.name).ends_with("rpm") &&
        !plain(named.name).ends_with("erpm"))
      named.unit = "rpm";
    if (const ToolColumn* known = tool_column(guess_.tool, c.name)) {
      take_known(*known, c);
      return c;
    }
    take_named(named, i, c);
    return c;
  }

 private:
  static bool is_canonical(const std::string& name) {
    const auto& known = canonical_columns();
    return std::find(known.begin(), known.end(), name) != known.end();
  }
  bool has_name(const std::string& name) const {
    return std::find(header_.names.begin(), header_.names.end(), name) != header_.names.end();
  }

  void take_known(const ToolColumn& known, GuessedColumn& c) const {
    const std::string canonical = known.canonical;
    if (canonical.empty()) {
      c.reason = known.text;
      return;
    }
    if (guess_.tool == "simplefoc" && request_.tool.empty() && canonical.starts_with("i_")) {
      c.reason = "A or mA? monitor() of SimpleFOC writes mA; --from simplefoc takes it so";
      return;
    }
    if (known.electrical && !request_.n_p) {
      c.reason = fmt::format("{}; --drive gives the pole pairs", known.text);
      return;
    }
    c.canonical = canonical;
    c.scale = known.electrical ? known.scale / *request_.n_p : known.scale;
    c.unit_from = fmt::format("{}, as {} writes it", known.text, guess_.tool);
  }

  void take_named(const NamedUnit& named, std::size_t i, GuessedColumn& c) const {
    const Meaning meaning = meaning_of(named.name, bare_names_);
    if (meaning.canonical.empty()) {
      c.reason = meaning.reason.empty() ? "no signal of a drive log by its name" : meaning.reason;
      return;
    }
    if (named.unit.empty()) {
      take_without_unit(meaning, i, c);
      return;
    }
    const auto unit = unit_of(named.unit);
    if (!unit) {
      c.reason = fmt::format("the unit \"{}\" is not known here", named.unit);
      return;
    }
    if (unit->quantity != meaning.quantity) {
      c.reason = fmt::format("\"{}\" is no unit of {}", named.unit, meaning.canonical);
      return;
    }
    if (!unit->problem.empty()) {
      c.reason = unit->problem;
      return;
    }
    const bool turns = meaning.quantity == Quantity::kAngle || meaning.quantity == Quantity::kSpeed;
    if (turns && !unit->mechanical && !meaning.said_mechanical) {
      c.reason = fmt::format("{} of the shaft or of the electrical angle? the name does not say",
                             named.unit);
      return;
    }
    c.canonical = meaning.canonical;
    c.scale = unit->scale;
    c.offset = unit->offset;
    c.unit_from = named.unit;
  }

  void take_without_unit(const Meaning& meaning, std::size_t i, GuessedColumn& c) const {
    const Values values = values_of(lines_, layout_, i);
    const auto understood = [&](double scale, std::string from) {
      c.canonical = meaning.canonical;
      c.scale = scale;
      c.unit_from = std::move(from);
    };
    const double max = values.max_abs(), step = values.median_step();
    switch (meaning.quantity) {
      case Quantity::kCurrent:
        if (max <= kMax_A && values.decimals >= kMinDecimals)
          understood(1, fmt::format("A by its values, up to {:.3g}: no unit in the file", max));
        else
          c.reason = fmt::format("A or mA? no unit in the file, values up to {:.3g}", max);
        return;
      case Quantity::kVoltage:
        if (max <= kMax_V && values.decimals >= 1)
          understood(1, fmt::format("V by its values, up to {:.3g}: no unit in the file", max));
        else
          c.reason = fmt::format("V or mV? no unit in the file, values up to {:.3g}", max);
        return;
      case Quantity::kTime:
        if (step >= kMinStep_s && step <= kMaxStep_s)
          understood(1, fmt::format("s by its steps of {:.3g}: no unit in the file", step));
        else
          c.reason = fmt::format("s, ms or us? no unit in the file, steps of {:.3g}", step);
        return;
      case Quantity::kAngle:
        if (!meaning.said_mechanical)
          c.reason = "mechanical or electrical, and in which unit? the name does not say";
        else if (values.restarts_at(kTwoPi))
          understood(1, "rad by its values, which restart at 2 pi: no unit in the file");
        else if (values.restarts_at(360))
          understood(kTwoPi / 360, "deg by its values, which restart at 360: no unit in the file");
        else
          c.reason = "rad, deg or turns? no unit in the file";
        return;
      case Quantity::kDuty: {
        const auto inside = [](double v) { return v >= 0 && v <= 1; };
        if (std::all_of(values.x.begin(), values.x.end(), inside) && max > 0.05)
          understood(1, "0 to 1 by its values");
        else
          c.reason = "its unit is not in the file";
        return;
      }
      case Quantity::kSpeed:
        c.reason = "rad/s or rpm, mechanical or electrical? no unit in the file";
        return;
      default:
        c.reason = "its unit is not in the file";
    }
  }

  const GuessRequest& request_;
  const Guess& guess_;
  const std::vector<std::string>& lines_;
  const Layout& layout_;
  const Header& header_;
  std::vector<std::string> bare_names_;
  bool drive_log_ = false;
};

void drop(GuessedColumn& column, std::string reason) {
  column.canonical.clear();
  column.reason = std::move(reason);
}

// Two columns with one meaning: neither is taken.
void drop_doubles(std::vector<GuessedColumn>& columns) {
  std::map<std::string, std::vector<GuessedColumn*>> by_name;
  for (GuessedColumn& c : columns)
    if (!c.canonical.empty()) by_name[c.canonical].push_back(&c);
  for (const auto& [name, doubles] : by_name) {
    if (doubles.size() < 2) continue;
    std::vector<std::string> numbers;
    for (const GuessedColumn* c : doubles) numbers.push_back(std::to_string(c->number));
    for (GuessedColumn* c : doubles)
      drop(*c, fmt::format("columns {} all read as {}", fmt::join(numbers, ", "), name));
  }
}

void note_the_rest(Guess& guess) {
  const bool time = guess.has("t");
  const bool time_named =
      std::any_of(guess.columns.begin(), guess.columns.end(), [](const GuessedColumn& c) {
        return meaning_of(named_unit(c.name).name, {}).quantity == Quantity::kTime;
      });
  const auto& fixed = static_columns();
  for (GuessedColumn& c : guess.columns)
    if ((time || time_named) && std::find(fixed.begin(), fixed.end(), c.canonical) != fixed.end())
      drop(c, "of sets without time only; a drive log has u_alpha, u_beta or u_d, u_q");
  if (!time) guess.notes.emplace_back("no time is understood: a drive log needs [time]");
  const bool dq = guess.has("i_d") || guess.has("i_q");
  if (time && dq && !guess.has("theta_m"))
    guess.notes.emplace_back(
        "i_d, i_q stand in the frame of the drive that wrote them; without theta_m they give no "
        "phase currents");
}

}  // namespace

const std::vector<std::string>& known_tools() {
  static const std::vector<std::string> tools{"vesc", "odrive", "moteus", "simplefoc", "matlab"};
  return tools;
}

bool Guess::has(const std::string& canonical) const {
  return std::any_of(columns.begin(), columns.end(),
                     [&](const GuessedColumn& c) { return c.canonical == canonical; });
}

Guess guess_map(const GuessRequest& request) {
  const bool mat = request.file.ends_with(".mat");
  if (!request.tool.empty() &&
      std::find(known_tools().begin(), known_tools().end(), request.tool) == known_tools().end())
    throw BadInput(
        fmt::format("--from {}: one of {} allowed", request.tool, fmt::join(known_tools(), ", ")));
  if (request.tool == "matlab" && !mat)
    throw BadInput(fmt::format("--from matlab: {} does not end in .mat", request.file));
  const std::vector<std::string> lines = lines_of(first_text(request.file));
  const Layout layout = best_layout(request.file, lines);
  Header header = header_of(lines, layout);
  Guess guess{.path = request.file};
  guess.numbered = made_utf8(header) || header.by_number;
  guess.tool =
      request.tool.empty() || request.tool == "matlab" ? tool_of(header.names) : request.tool;
  if (!request.tool.empty() && request.tool != "matlab" &&
      std::none_of(header.names.begin(), header.names.end(), [&](const std::string& name) {
        return tool_column(request.tool, name) || tool_column(request.tool, named_unit(name).name);
      }))
    throw BadInput(fmt::format("--from {}: {} has no column that {} writes; it has {}",
                               request.tool, request.file, request.tool,
                               fmt::join(header.names, ", ")));
  guess.format.separator = layout.separator;
  guess.format.decimal = layout.decimal;
  guess.format.skip = static_cast<int>(header.skip);
  guess.format.header = !header.by_number;
  const Guesser guesser(request, guess, lines, layout, header);
  for (std::size_t i = 0; i < layout.fields; ++i) {
    if (i + 1 == layout.fields && header.names[i].empty()) break;  // behind the last separator
    guess.columns.push_back(guesser.column(i));
  }
  drop_doubles(guess.columns);
  note_the_rest(guess);
  return guess;
}

namespace {

// Of a TOML basic string; empty if the text needs escapes that a header cannot have.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) return "";
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return text;
}

std::string from_of(const Guess& guess, const GuessedColumn& c) {
  const auto doubles =
      std::count_if(guess.columns.begin(), guess.columns.end(),
                    [&](const GuessedColumn& other) { return other.name == c.name; });
  const std::string name = quoted(c.name);
  return guess.numbered || doubles > 1 || name.empty() ? std::to_string(c.number) : name;
}

std::string fields_text(const GuessedColumn& c) {
  std::string text;
  if (c.scale != 1) text += fmt::format(", scale = {}", c.scale);
  if (c.offset != 0) text += fmt::format(", offset = {}", c.offset);
  if (c.wrap != 0) text += fmt::format(", wrap = {}", c.wrap);
  return text;
}

}  // namespace

std::string map_toml(const Guess& guess, const std::string& preset) {
  std::string text = fmt::format("# Guessed from the first rows of {}. Check it.\n[columns]\n",
                                 one_line(guess.path.substr(guess.path.rfind('/') + 1)));
  const auto behind = [&](const GuessedColumn& c) {
    return one_line(guess.numbered ? c.name + ": " + c.unit_from : c.unit_from);
  };
  for (const GuessedColumn& c : guess.columns)
    if (!c.canonical.empty() && c.canonical != "t")
      text += fmt::format("{} = {{ from = {}{} }}  # {}\n", c.canonical, from_of(guess, c),
                          fields_text(c), behind(c));
  for (const GuessedColumn& c : guess.columns)
    if (c.canonical.empty())
      text += fmt::format("# not understood: {} (column {}): {}\n", one_line(c.name), c.number,
                          one_line(c.reason));
  for (const GuessedColumn& c : guess.columns)
    if (c.canonical == "t")
      text += fmt::format("\n[time]\nfrom = {}  # {}\nscale = {}\n", from_of(guess, c), behind(c),
                          c.scale);
  const auto character = [](char c) { return c == '\t' ? std::string("\\t") : std::string(1, c); };
  text += fmt::format("\n[file]\nseparator = \"{}\"\ndecimal = \"{}\"\n",
                      character(guess.format.separator), guess.format.decimal);
  if (guess.format.skip > 0) text += fmt::format("skip = {}\n", guess.format.skip);
  if (!guess.format.header) text += "header = false\n";
  if (!preset.empty()) text += fmt::format("\n[drive]\npreset = \"{}\"\n", preset);
  return text;
}

}  // namespace twinrate

#include <fmt/format.h>

#include <algorithm>

#include "import/guess.hpp"

namespace twinrate {
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

#include "core/toml_text.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "core/config.hpp"
#include "core/lcm_socket.hpp"
#include "core/message_check.hpp"

namespace twinrate {
namespace {

// The place after the string that begins at `at` with a quote. One of a single line ends with it:
// TOML allows no line end in it.
std::size_t end_of_string(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string three(3, quote);
  const bool long_form = text.substr(at, 3) == three;
  for (at += long_form ? 3 : 1; at < text.size(); ++at) {
    if (text[at] == '\\' && quote == '"') {
      ++at;
    } else if (long_form ? text.substr(at, 3) == three : text[at] == quote) {
      if (!long_form) return at + 1;
      at += 3;  // two further quotes still belong to it
      for (int i = 0; i < 2 && at < text.size() && text[at] == quote; ++i) ++at;
      return at;
    } else if (!long_form && text[at] == '\n') {
      return at;
    }
  }
  return text.size();
}

// The line of the first key with too many dots; 0: none.
std::ptrdiff_t line_of_long_key(std::string_view text) {
  int dots = 0;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      i = end_of_string(text, i);
      continue;
    }
    if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
      continue;
    }
    if (c == '.' && ++dots > kMaxKeyDots)
      return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(i), '\n');
    if (std::string_view("\n=,[]{}").find(c) != std::string_view::npos) dots = 0;
    ++i;
  }
  return 0;
}

}  // namespace

std::string read_text_file(const std::string& path) {
  const FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  std::string text;
  std::array<char, 1 << 16> block;
  for (ssize_t got = file.get() < 0 ? -1 : 1; got != 0;) {
    if (got > 0) got = read(file.get(), block.data(), block.size());
    if (got < 0) throw BadInput(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
    text.append(block.data(), static_cast<std::size_t>(got));
    if (text.size() > kMaxMessageBytes)
      throw BadInput(fmt::format("{}: at most {} MB allowed", path, kMaxMessageBytes >> 20));
  }
  return text;
}

toml::table parse_toml(const std::string& text, const std::string& source) {
  if (const std::ptrdiff_t line = line_of_long_key(text); line > 0)
    throw BadInput(
        fmt::format("{}:{}: a key of at most {} dots allowed", source, line, kMaxKeyDots));
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw BadInput(
        fmt::format("{}:{}: {}", source, error.source().begin.line, error.description()));
  }
}

}  // namespace twinrate

#include "core/command_line.hpp"

#include <string_view>

namespace twinrate {
namespace {

std::string quoted(std::string_view word) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=.,:/@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string_view::npos)
    return std::string(word);
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

std::string& remembered() {
  static std::string text;
  return text;
}

}  // namespace

std::string command_text(int argc, const char* const* argv) {
  std::string text;
  for (int i = 0; i < argc; ++i) {
    std::string_view word = argv[i];
    if (i == 0) word = word.substr(word.rfind('/') + 1);
    text += (i == 0 ? "" : " ") + quoted(word);
  }
  return text;
}

void remember_command(std::string text) {
  remembered() = std::move(text);
}

const std::string& remembered_command() {
  return remembered();
}

}  // namespace twinrate

#include "bench/command_line.hpp"

#include <CLI/CLI.hpp>

namespace twinrate::bench {

using Option = CommandLine::Option;

Option& Option::required() {
  option_.required();
  return *this;
}
Option& Option::among(const std::vector<std::string>& values) {
  option_.check(CLI::IsMember(values));
  return *this;
}
Option& Option::existing_file() {
  option_.check(CLI::ExistingFile);
  return *this;
}
Option& Option::by_comma() {
  option_.delimiter(',');
  return *this;
}
Option& Option::one_value_each() {
  option_.allow_extra_args(false);
  return *this;
}

CommandLine::CommandLine(const std::string& description)
    : app_(std::make_unique<CLI::App>(description)) {}
CommandLine::~CommandLine() = default;

Option CommandLine::option(const std::string& name, OptionValue value, const std::string& text) {
  return Option(std::visit(
      [&](auto* target) -> CLI::Option& { return *app_->add_option(name, *target, text); }, value));
}

void CommandLine::flag(const std::string& name, bool& on, const std::string& text) {
  app_->add_flag(name, on, text);
}

std::optional<int> CommandLine::parse(int argc, char** argv) {
  try {
    app_->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app_->exit(error);
  }
  return std::nullopt;
}

}  // namespace twinrate::bench

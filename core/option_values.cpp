#include "core/option_values.hpp"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>

namespace twinrate {
namespace {

std::string empty_value(const std::string& text) {
  return text.empty() ? "a value is required, found an empty text" : "";
}

// CLI11 lets "nan" pass its ranges, and takes the largest of the type for a number beyond it.
std::string no_finite_number(const std::string& text) {
  double number = 0;
  const bool is_number = CLI::detail::lexical_cast(text, number);
  return is_number && std::isfinite(number) ? "" : "a finite number allowed, found " + text;
}

std::string no_whole_number(const std::string& text) {
  std::int64_t number = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] =
      std::from_chars(text.data() + (text.starts_with('+') ? 1 : 0), end, number);
  return error == std::errc() && stop == end ? ""
                                             : "a whole number below 2^63 allowed, found " + text;
}

// A text that is no number is reported by expect_stated_values().
CLI::Validator from_zero(bool with_zero, const char* name) {
  const auto refuse = [with_zero](const std::string& text) -> std::string {
    double number = 0;
    const bool allowed = !CLI::detail::lexical_cast(text, number) || number > 0 ||
                         (with_zero && number == 0) || std::isnan(number);
    return allowed ? ""
                   : (with_zero ? "0 or more allowed, found " : "above 0 allowed, found ") + text;
  };
  return {refuse, name};
}

}  // namespace

CLI::Validator above_zero() {
  return from_zero(false, "POSITIVE");
}

CLI::Validator zero_or_more() {
  return from_zero(true, "NONNEGATIVE");
}

void expect_stated_values(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    if (option->get_items_expected_max() == 0) continue;  // a flag
    if (!option->check_lname("channel-suffix")) option->check(empty_value);
    const std::string type = option->get_type_name();
    if (type.find("FLOAT") != std::string::npos) option->check(no_finite_number);
    if (type.find("INT") != std::string::npos) option->check(no_whole_number);
  }
  for (CLI::App* verb : app.get_subcommands([](CLI::App*) { return true; }))
    expect_stated_values(*verb);
}

}  // namespace twinrate

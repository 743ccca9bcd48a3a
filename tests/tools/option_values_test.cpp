// Every numeric option of every verb and process, found by their --help, refuses what no number of its
// kind can be; every option refuses an empty text.
#include "core/option_values.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <regex>
#include <sstream>

#include "core/config.hpp"
#include "core/process.hpp"
#include "tools/run_verb.hpp"

namespace twinrate {
namespace {

using Words = std::vector<std::string>;

struct Option {
  std::string name, type;
};

std::vector<const char*> pointers(const Words& words) {
  std::vector<const char*> list;
  list.reserve(words.size() + 1);
  for (const std::string& word : words) list.push_back(word.c_str());
  list.push_back(nullptr);
  return list;
}

std::string refusal_of_verb(const Words& words) {
  try {
    run_verb(static_cast<int>(words.size()), pointers(words).data());
  } catch (const BadInput& error) {
    return error.what();
  }
  return "";
}

std::string help_of(Words words) {
  words.emplace_back("--help");
  testing::internal::CaptureStdout();
  refusal_of_verb(words);
  return testing::internal::GetCapturedStdout();
}

std::vector<Option> options_in(const std::string& help) {
  static const std::regex kLine(R"(^  (?:-\w,)?(--[a-z0-9-]+)\S* (FLOAT|INT|UINT|TEXT)\b)");
  std::vector<Option> options;
  std::istringstream lines(help);
  std::smatch found;
  for (std::string line; std::getline(lines, line);)
    if (std::regex_search(line, found, kLine)) options.push_back({found[1], found[2]});
  return options;
}

std::vector<std::string> verbs_in(const std::string& help) {
  static const std::regex kLine(R"(^  ([a-z][a-z-]*)\s)");
  std::vector<std::string> verbs;
  const auto from = help.find("\nSubcommands:");
  if (from == std::string::npos) return verbs;
  std::istringstream lines(help.substr(from));
  std::smatch found;
  for (std::string line; std::getline(lines, line);)
    if (std::regex_search(line, found, kLine)) verbs.push_back(found[1]);
  return verbs;
}

Words impossible(const Option& option) {
  if (option.name == "--channel-suffix") return {};
  if (option.type == "TEXT") return {""};
  Words values = {"", "nan", "inf", "-inf", "1e400", "0x"};
  if (option.type != "FLOAT") values.emplace_back("99999999999999999999");
  return values;
}

// Visits each option; returns how many have numbers.
int check_all(const Words& command) {
  const std::string help = help_of(command);
  int numbers = 0;
  for (const Option& option : options_in(help)) {
    numbers += option.type != "TEXT";
    for (const std::string& value : impossible(option)) {
      Words words = command;
      words.insert(words.end(), {option.name, value});
      EXPECT_NE(refusal_of_verb(words).find(option.name + ":"), std::string::npos)
          << fmt::format("{} '{}'", fmt::join(command, " "), value) << " " << option.name << ": "
          << refusal_of_verb(words);
    }
  }
  for (const std::string& verb : verbs_in(help)) {
    Words inner = command;
    inner.push_back(verb);
    numbers += check_all(inner);
  }
  return numbers;
}

TEST(OptionValues, NoVerbTakesWhatNoNumberCanBe) {
  EXPECT_GT(check_all({"twinrate"}), 25);
}

TEST(OptionValues, NoProcessTakesWhatNoNumberCanBe) {
  for (const char* option : {"--session", "--cpu", "--helper-cpu"})
    for (const char* value : {"", "nan", "-7", "99999999999999999999"}) {
      Words words = {"twinrate-gain", "--config", "dilys2021", option, value};
      std::vector<const char*> arguments = pointers(words);
      testing::internal::CaptureStderr();
      const int code =
          run_process({Role::kGain, "twinrate-gain", ""}, static_cast<int>(words.size()),
                      const_cast<char**>(arguments.data()), [](Process&) { FAIL(); });
      EXPECT_EQ(code, 2) << option << " " << value;
      EXPECT_NE(testing::internal::GetCapturedStderr().find(option), std::string::npos) << value;
    }
}

}  // namespace
}  // namespace twinrate

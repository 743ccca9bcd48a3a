// The options of a bench. CLI11 stays in one translation unit: it adds six seconds of CPU time to each that includes it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace twinrate::bench {

// Where an option puts its value. Lists take several values.
using OptionValue = std::variant<int*, std::uint64_t*, double*, std::string*, std::vector<int>*,
                                 std::vector<double>*, std::vector<std::string>*>;

class CommandLine {
 public:
  class Option {
   public:
    explicit Option(CLI::Option& option) : option_(option) {}
    Option& required();
    Option& among(const std::vector<std::string>& values);
    Option& existing_file();
    Option& by_comma();        // a list as one text, too
    Option& one_value_each();  // a list grows by one value with each occurrence of the option

   private:
    CLI::Option& option_;
  };

  explicit CommandLine(const std::string& description);
  ~CommandLine();

  // "--name" is an option, "NAME" a position.
  Option option(const std::string& name, OptionValue value, const std::string& text);
  void flag(const std::string& name, bool& on, const std::string& text);

  // The exit code where the program ends here: --help, or a bad option with its line on standard error.
  std::optional<int> parse(int argc, char** argv);

 private:
  std::unique_ptr<CLI::App> app_;
};

}  // namespace twinrate::bench

// Every command of README.md, docs/ and examples/ runs and prints what its page shows.
//
// A page runs from top to bottom in an empty directory of its own, in a network namespace of its
// own, with the programs on PATH and with links to the source's config/, docs/, tools/ and to
// build/. A block, fenced without a language or indented by four spaces, is read like this:
//
//   console    it has lines "$ COMMAND": each command runs, and what the page shows below it is
//              compared with the output. A command without text below it is not compared.
//   script     its first word is a program (kPrograms): it runs as one script, which stops at the
//              first command that fails. No output is compared.
//   Python     a ```python block runs as one program with the module of the build; without the module
//              it is skipped. What it prints is not compared.
//   file       a ```toml block whose first line is "# NAME.toml": NAME.toml is written.
//
// The exit code has to be 0, or the N of a comment "# exit code N" behind the command.
//
// Output is compared line by line. "..." in the page, alone in a line, stands for any number of
// lines, and so it does at the end of a line for the rest of it. Numbers may differ by one in their
// last shown digit (kernels and libm differ between processors); wall time, steps/s, messages sent
// again, the BIC of a trace and names of run directories are not compared.
//
// The pages of docs/notebooks are run as notebooks: tests/python.
//
// Commands inside a sentence are names and patterns; docs_test.cpp checks their verbs and keys.
//
// An HTML comment in front of a block changes this; the reader of the page does not see it:
//
//   <!-- test: skip, REASON -->      does not run here; the test prints the reason
//   <!-- test: long, REASON -->      runs only if TWINRATE_DOCS=long is set
//   <!-- test: uncompared, REASON -->  runs; its output is not compared
//   <!-- test: first, COMMANDS -->   runs COMMANDS before the block
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <regex>
#include <sstream>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = TWINRATE_SOURCE_DIR;
const fs::path kBuild = TWINRATE_BINARY_DIR;
const std::regex kPrograms(
    R"(^(PATH=|(\./)?tools/|build/|examples/|twinrate\b|lcm-|mpirun|sbatch|unshare|for ))");
constexpr double kLimit_s = 300;  // of a command, on a busy machine

struct Command {
  int line = 0;
  std::string text;
  int exit_code = 0;
  std::vector<std::string> shown;  // empty: not compared
};

struct Block {
  int line = 0;
  std::string language;
  std::vector<std::string> lines;
  std::string first, skipped, long_reason, uncompared;  // of the comments in front of it
};

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t"), end = text.find_last_not_of(" \t");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

// The blocks of a page. Comments bind to the next block.
std::vector<Block> blocks_of(const std::string& page) {
  const std::regex comment(R"(^<!-- test: (skip|long|first|uncompared), (.*) -->$)");
  std::vector<Block> blocks;
  Block block;
  const auto end_block = [&] {
    while (!block.lines.empty() && trimmed(block.lines.back()).empty()) block.lines.pop_back();
    if (!block.lines.empty()) blocks.push_back(block);
    block = Block{};
  };
  bool fenced = false, indented = false, after_blank = true;
  int number = 0;
  for (const std::string& line : lines_of(page)) {
    ++number;
    std::smatch found;
    if (indented && !line.starts_with("    ") && !trimmed(line).empty()) {
      end_block();
      indented = false;
    }
    if (line.starts_with("```")) {
      if (fenced)
        end_block();
      else
        block.language = trimmed(line.substr(3)), block.line = number + 1;
      fenced = !fenced;
    } else if (fenced) {
      block.lines.push_back(line);
    } else if (std::regex_match(line, found, comment)) {
      (found[1] == "skip"    ? block.skipped
       : found[1] == "long"  ? block.long_reason
       : found[1] == "first" ? block.first
                             : block.uncompared) = found[2];
    } else if (indented || (after_blank && line.starts_with("    "))) {
      if (!indented) block.line = number;
      indented = true;
      block.lines.push_back(line.size() > 4 ? line.substr(4) : "");
    }
    after_blank = trimmed(line).empty();
  }
  end_block();
  return blocks;
}

int exit_code_in(const std::string& text) {
  std::smatch found;
  return std::regex_search(text, found, std::regex("# .*exit code ([0-9])")) ? std::stoi(found[1])
                                                                             : 0;
}

// The program of a ```python block; empty without the module.
std::vector<Command> python_of(const Block& block) {
  const std::string python = TWINRATE_PYTHON_PROGRAM;
  if (python.empty()) return {};
  return {
      {block.line,
       fmt::format("{} - <<'END_OF_BLOCK'\n{}\nEND_OF_BLOCK", python, fmt::join(block.lines, "\n")),
       0,
       {}}};
}

// The commands of a block; none where it shows something else.
std::vector<Command> commands_of(const Block& block) {
  if (block.language == "python") return python_of(block);
  if (!block.language.empty() || block.lines.empty()) return {};
  std::vector<Command> commands;
  bool console = false;
  for (const std::string& line : block.lines) console = console || line.starts_with("$ ");
  if (!console) {
    if (!std::regex_search(block.lines.front(), kPrograms)) return {};
    std::string script;
    for (const std::string& line : block.lines) {
      const int code = exit_code_in(line);
      script += code == 0 ? line + "\n"
                          : fmt::format("code=0; {} || code=$?; [ $code = {} ]\n",
                                        trimmed(line.substr(0, line.find(" #"))), code);
    }
    return {{block.line, script, 0, {}}};
  }
  for (std::size_t i = 0; i < block.lines.size(); ++i) {
    const std::string& line = block.lines[i];
    if (line.starts_with("$ ")) {
      commands.push_back(
          {block.line + static_cast<int>(i), line.substr(2), exit_code_in(line), {}});
    } else if (!commands.empty()) {
      Command& last = commands.back();
      if (last.shown.empty() && last.text.ends_with("\\"))
        last.text += "\n" + line;
      else
        last.shown.push_back(line);
    }
  }
  return commands;
}

// What depends on the machine or on the moment, put out of the way.
std::string without_machine(std::string line) {
  static const std::vector<std::pair<std::regex, std::string>> kMachine = {
      {std::regex(R"([0-9]+ steps/s \([0-9.]+ s wall\))"), "STEPS"},
      {std::regex(R"(sent again: [0-9]+)"), "sent again"},
      {std::regex(R"([0-9]+ sent again)"), "sent again"},
      {std::regex(R"(ticks in [0-9.]+ s)"), "ticks"},
      {std::regex(R"(report\.html \([0-9.]+ s\))"), "report.html"},
      {std::regex(R"(BIC -?[0-9]+)"), "BIC"},
      {std::regex(R"(runs/[a-z0-9_-]*[0-9]{8}-[0-9]{6})"), "RUN"},
      {std::regex(R"([ \t]+)"), " "},
      {std::regex(R"( $)"), ""}};
  for (const auto& [pattern, name] : kMachine) line = std::regex_replace(line, pattern, name);
  return line;
}

const std::regex kNumber(R"([0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?)");

double last_place(const std::string& number) {
  const auto exponent = number.find('e');
  const std::string mantissa = number.substr(0, exponent);
  const auto point = mantissa.find('.');
  if (point == std::string::npos) return 0;
  const int power = exponent == std::string::npos ? 0 : std::stoi(number.substr(exponent + 1));
  return std::pow(10.0, power - static_cast<double>(mantissa.size() - point - 1));
}

bool same_line(const std::string& page, const std::string& program) {
  const std::string shown = without_machine(page);
  std::string printed = without_machine(program);
  std::string rest = shown;
  const bool open = rest.ends_with("...");
  if (open) rest.resize(rest.size() - 3);
  std::size_t at = 0;  // in `printed`
  std::sregex_iterator number(rest.begin(), rest.end(), kNumber), end;
  std::size_t from = 0;  // in `rest`
  for (; number != end; ++number) {
    const std::string text = rest.substr(from, static_cast<std::size_t>(number->position()) - from);
    if (printed.compare(at, text.size(), text) != 0) return false;
    at += text.size();
    std::smatch other;
    const std::string behind = printed.substr(std::min(at, printed.size()));
    if (!std::regex_search(behind, other, kNumber, std::regex_constants::match_continuous))
      return false;
    const std::string wanted = number->str();
    if (wanted != other.str() &&
        !(std::abs(std::stod(wanted) - std::stod(other.str())) <= 1.01 * last_place(wanted)))
      return false;
    at += static_cast<std::size_t>(other.length());
    from = static_cast<std::size_t>(number->position() + number->length());
  }
  const std::string text = rest.substr(from);
  if (at > printed.size() || printed.compare(at, text.size(), text) != 0) return false;
  return open || at + text.size() == printed.size();
}

// "" if `printed` equals the output in the page, else the difference.

std::string difference(const std::vector<std::string>& shown,
                       const std::vector<std::string>& printed) {
  std::size_t at = 0;
  bool skipping = false;
  for (const std::string& line : shown) {
    if (trimmed(line) == "...") {
      skipping = true;
      continue;
    }
    if (skipping)
      while (at < printed.size() && !same_line(line, printed[at])) ++at;
    if (at >= printed.size()) return "not printed: " + line;
    if (!same_line(line, printed[at]))
      return fmt::format("the page shows: {}\nprinted is:     {}", line, printed[at]);
    skipping = false;
    ++at;
  }
  if (!skipping && at < printed.size()) return "not on the page: " + printed[at];
  return "";
}

std::vector<std::string> without_empty(std::vector<std::string> lines) {
  std::erase_if(lines, [](const std::string& line) { return trimmed(line).empty(); });
  return lines;
}

std::vector<std::string> pages_with_commands() {
  std::vector<std::string> pages;
  const auto take = [&pages](const fs::path& page) {
    for (const Block& block : blocks_of(read_text(page.string())))
      if (!commands_of(block).empty()) {
        pages.push_back(fs::relative(page, kRoot).string());
        return;
      }
  };
  take(kRoot / "README.md");
  take(kRoot / "ARCHITECTURE.md");
  std::vector<std::string> folders = {"docs"};
  if (!std::string(TWINRATE_PYTHON_PROGRAM).empty()) folders.emplace_back("examples");
  for (const std::string& folder : folders)
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / folder))
      if (entry.path().extension() == ".md" && entry.path().parent_path().filename() != "notebooks")
        take(entry.path());
  std::sort(pages.begin(), pages.end());
  return pages;
}

class Commands : public ProgramTest, public ::testing::WithParamInterface<std::string> {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    if (IsSkipped()) return;
    for (const char* folder : {"config", "docs", "examples", "tools"})
      fs::create_directory_symlink(kRoot / folder, path(folder));
    fs::create_directory_symlink(kBuild, path("build"));
    std::string search;
    for (const char* folder :
         {"tools", "plant_sim", "estimator", "controller", "logger", "monitor"})
      search += (kBuild / folder).string() + ":";
    const std::string python = fs::path(TWINRATE_PYTHON_PROGRAM).parent_path();
    if (!python.empty()) search += python + ":";  // of the module, for "env python3"
    setenv("PATH", (search + getenv("PATH")).c_str(), 1);
    setenv("PYTHONDONTWRITEBYTECODE", "1", 1);
    setenv("PYTHONPATH", (kBuild / "python").c_str(), 1);
    unsetenv("TWINRATE_MEASURED");
  }
  ProgramResult run(const std::string& script) {
    return run_program(
        {"bash", "-c",
         fmt::format("cd {} && exec 2>&1 && set -e -o pipefail\n{}", path("."), script)},
        kLimit_s);
  }
  void check(const Command& command) {
    const std::string where = fmt::format("{}:{}", GetParam(), command.line);
    const ProgramResult result = run(command.text);
    ASSERT_FALSE(result.timed_out) << where << "\n" << command.text;
    EXPECT_EQ(result.exit_code, command.exit_code) << where << "\n"
                                                   << command.text << "\n"
                                                   << result.out;
    if (!command.shown.empty()) {
      EXPECT_EQ(difference(without_empty(command.shown), without_empty(lines_of(result.out))), "")
          << where << "\n"
          << command.text << "\n"
          << result.out;
    }
    fmt::print("{}: {:.1f} s, {}\n", where, result.wall_s, lines_of(command.text).front());
  }
};

TEST_P(Commands, RunAndPrintWhatThePageShows) {
  const char* wanted = getenv("TWINRATE_DOCS");
  const bool long_too = wanted && std::string(wanted) == "long";
  for (const Block& block : blocks_of(read_text((kRoot / GetParam()).string()))) {
    if (block.language == "toml" && std::regex_match(block.lines[0], std::regex("# [^ ]*\\.toml")))
      write_text(path(block.lines[0].substr(2)), fmt::format("{}\n", fmt::join(block.lines, "\n")));
    const std::vector<Command> commands = commands_of(block);
    if (commands.empty()) continue;
    const std::string reason = !block.skipped.empty() ? block.skipped
                               : long_too             ? ""
                                                      : block.long_reason;
    if (!reason.empty()) {
      fmt::print("{}:{}: skipped: {}\n", GetParam(), block.line, reason);
      continue;
    }
    if (!block.first.empty()) {
      const ProgramResult made = run(block.first);
      ASSERT_EQ(made.exit_code, 0) << block.first << "\n" << made.out;
    }
    for (Command command : commands) {
      if (!block.uncompared.empty()) command.shown.clear();
      check(command);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Docs, Commands, ::testing::ValuesIn(pages_with_commands()),
                         [](const auto& page) {
                           return std::regex_replace(page.param, std::regex("[^A-Za-z0-9]"), "_");
                         });

}  // namespace
}  // namespace twinrate::test

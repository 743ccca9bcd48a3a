#include "embedded/instruction_counts.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/machine_error.hpp"
#include "core/paths.hpp"
#include "embedded/closed_run.hpp"
#include "embedded/fixed_estimator.hpp"
#include "embedded/scratch.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

// Output of a command; throws MachineError if it fails.
std::string output_of(const std::string& command) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (!pipe) throw MachineError("cannot run: " + command);
  std::string text;
  std::array<char, 4096> buffer;
  while (const std::size_t n = fread(buffer.data(), 1, buffer.size(), pipe))
    text.append(buffer.data(), n);
  if (pclose(pipe) != 0) throw MachineError(fmt::format("failed: {}\n{}", command, text));
  return text;
}

std::string first_line(const std::string& text) {
  return text.substr(0, text.find('\n'));
}

// Writes the samples of the first 0.2 s of the drive, from standstill to 400 rad/s, and the table
// of policy scheduled.
void write_inputs(const fs::path& directory) {
  Config config = load_drive("dilys2021", {"rates.n=1", "run.duration_s=0.2"});
  Fixed32 filter(config);
  const RunLog log = closed_run(config, [&](const Measurement& m) { return filter.tick(m); });
  Config scheduled = load_drive("dilys2021", {"rates.n=1", "gain.policy=scheduled"});
  m3::Settings settings = fixed_settings(scheduled);
  std::ofstream out(directory / "settings.bin", std::ios::binary);
  const auto put = [&](const auto& part) {
    out.write(reinterpret_cast<const char*>(&part), sizeof part);
  };
  put(settings);
  put(static_cast<std::uint32_t>(log.measurement.size()));
  for (const Measurement& m : log.measurement) put(m3::reading<m3::Plain32>(sample_of(m)));
}

struct SysTickStep {
  std::string name;
  std::uint32_t address = 0;
  long calls = 0, sum = 0, least = 0, most = 0;
};
struct SysTickCount {
  std::uint32_t begin = 0, end = 0;
  std::vector<SysTickStep> steps;
};

SysTickCount read_systick(const fs::path& path) {
  std::ifstream in(path);
  SysTickCount count;
  std::string word, ignored;
  while (in >> word) {
    if (word == "mark") {
      in >> ignored >> count.begin >> ignored >> count.end;
    } else {
      SysTickStep s;
      in >> s.name >> s.address >> s.calls >> s.sum >> s.least >> s.most;
      count.steps.push_back(s);
    }
  }
  return count;
}

struct Execution {
  std::uint32_t address;
  double executed, taken;
};
std::map<std::uint32_t, std::vector<Execution>> read_executions(const fs::path& path) {
  std::ifstream in(path);
  std::map<std::uint32_t, std::vector<Execution>> of_step;
  std::uint32_t step = 0;
  Execution e{};
  while (in >> step >> e.address >> e.executed >> e.taken) of_step[step].push_back(e);
  return of_step;
}

// Address -> cycles, of the lines "  1a4:<tab>fb80 0103 <tab>smull<tab>r0, r1, r0, r3".
std::map<std::uint32_t, Cycles> read_classes(const std::string& listing) {
  std::map<std::uint32_t, Cycles> classes;
  std::istringstream in(listing);
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> columns;
    std::istringstream row(line);
    for (std::string column; std::getline(row, column, '\t');) columns.push_back(column);
    if (columns.size() < 3 || !columns[0].ends_with(":")) continue;
    const auto address = static_cast<std::uint32_t>(std::stoul(columns[0], nullptr, 16));
    classes[address] = cycles_of(columns[2], columns.size() > 3 ? columns[3] : "");
  }
  return classes;
}

std::string emulator_command(const std::string& options) {
  return fmt::format(
      "qemu-system-arm -M mps2-an385 -nographic -semihosting-config enable=on,target=native {} "
      "-kernel {}/count.elf",
      options, cortex_directory());
}

StepCount combined(const SysTickStep& s, const SysTickStep& empty,
                   const std::vector<Execution>& executions,
                   const std::map<std::uint32_t, Cycles>& classes) {
  const auto calls = static_cast<double>(s.calls);
  const long harness = empty.least - 1;  // the empty step itself is one instruction
  StepCount step{.name = s.name,
                 .instructions = static_cast<double>(s.sum) / calls - static_cast<double>(harness),
                 .least = static_cast<int>(s.least - harness),
                 .most = static_cast<int>(s.most - harness)};
  double executed = 0;
  for (const Execution& e : executions) {
    const Cycles c = classes.at(e.address);
    executed += e.executed;
    step.cycles_low += (e.executed * c.low + 1 * e.taken) / calls;
    step.cycles_high += (e.executed * c.high + 3 * e.taken) / calls;
  }
  if (executed != step.instructions * calls)
    throw std::runtime_error(fmt::format("{}: {} instructions by SysTick, {} by the plugin", s.name,
                                         step.instructions * calls, executed));
  return step;
}

}  // namespace

const StepCount& CortexCounts::at(const std::string& name) const {
  for (const StepCount& step : steps)
    if (step.name == name) return step;
  throw std::out_of_range(name);
}

std::string cortex_directory() {
  return TWINRATE_CORTEX_DIRECTORY;
}

std::string why_no_cortex() {
  for (const char* file : {"count.elf", "loop.elf", "libcount_plugin.so"})
    if (!fs::exists(cortex_directory() + "/" + file))
      return fmt::format(
          "{}/{} is not built: install the packages of [cortex] in "
          "tools/packages.txt, then configure and build again",
          cortex_directory(), file);
  if (std::system("command -v qemu-system-arm >/dev/null 2>&1") != 0)
    return "qemu-system-arm is not installed (tools/packages.txt, [cortex])";
  return "";
}

static bool begins(const std::string& text, const char* with) {
  return text.starts_with(with);
}

Cycles cycles_of(const std::string& mnemonic, const std::string& operands) {
  const std::string name = mnemonic.substr(0, mnemonic.find_first_of(" ."));
  const auto is = [&](const char* with) { return begins(name, with); };
  if (is("smull") || is("umull")) return {3, 5};
  if (is("smlal") || is("umlal")) return {4, 7};
  if (is("mla") || is("mls")) return {2, 2};
  if (is("sdiv") || is("udiv")) return {2, 12};
  if (is("ldrd") || is("strd")) return {3, 3};
  if (is("ldm") || is("stm") || is("push") || is("pop")) {
    double registers = 1;
    for (const char c : operands.substr(operands.find('{'))) registers += c == ',';
    return {1 + registers, 1 + registers};
  }
  if (is("ldr") || is("str")) return {1, 2};
  if (is("it")) return {0, 1};
  return {1, 1};
}

CortexCounts count_instructions() {
  if (const std::string why = why_no_cortex(); !why.empty()) throw MachineError(why);
  const Scratch scratch;
  write_inputs(scratch.path());
  const std::string command = emulator_command("-icount shift=7");
  const std::string there = fmt::format("cd {} && timeout 60 ", scratch.path());
  output_of(there + command);
  const SysTickCount systick = read_systick(scratch.path() + "/counts.txt");
  if (systick.steps.empty() || systick.steps.front().name != "empty")
    throw MachineError("the counting image wrote no counts");
  output_of(there + emulator_command(fmt::format(
                        "-plugin {}/libcount_plugin.so,begin={},end={},out=executions.txt",
                        cortex_directory(), systick.begin, systick.end)));
  const auto executions = read_executions(scratch.path() + "/executions.txt");
  const auto classes = read_classes(
      output_of(fmt::format("arm-none-eabi-objdump -d {}/count.elf", cortex_directory())));
  CortexCounts counts;
  for (const SysTickStep& s : systick.steps)
    if (s.name != "empty")
      counts.steps.push_back(combined(s, systick.steps.front(), executions.at(s.address), classes));
  counts.command = "build/embedded/cortex_m3 count";
  counts.compiler = first_line(output_of("arm-none-eabi-g++ --version"));
  counts.emulator = first_line(output_of("qemu-system-arm --version"));
  counts.revision = revision();
  return counts;
}

std::string to_json(const CortexCounts& counts) {
  nlohmann::ordered_json json = {{"command", counts.command},
                                 {"compiler", counts.compiler},
                                 {"emulator", counts.emulator},
                                 {"revision", counts.revision}};
  const auto rounded = [](double x) { return std::round(100 * x) / 100; };
  for (const StepCount& s : counts.steps)
    json["steps"][s.name] = {{"instructions", s.instructions},
                             {"least", s.least},
                             {"most", s.most},
                             {"cycles_low", rounded(s.cycles_low)},
                             {"cycles_high", rounded(s.cycles_high)}};
  return json.dump(1) + "\n";
}

}  // namespace twinrate

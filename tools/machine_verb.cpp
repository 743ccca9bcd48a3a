// twinrate machine new NAME: writes a drive file from the values of a data sheet.
// twinrate machine list: the presets, with their ratings and their first comment line.
#include <fmt/format.h>
#include <unistd.h>

#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/output_file.hpp"
#include "datasheet/drive_of_sheet.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct MachineOptions {
  std::string name, out;
  std::vector<std::string> from;
  bool force = false, json = false;
};

std::string known_keys() {
  std::string text = "Keys of --from:\n";
  for (const SheetKey& key : Sheet::keys()) {
    text += fmt::format("  {:<22} {}", key.key, key.meaning);
    if (!key.choices.empty()) text += fmt::format(" ({})", fmt::join(key.choices, ", "));
    text += "\n";
  }
  return text;
}

Sheet sheet_of(const MachineOptions& o) {
  if (!o.from.empty()) return read_sheet(o.from);
  if (!isatty(STDIN_FILENO))
    throw BadInput(
        "machine new: --from key=value .. is required where nobody can be asked; see "
        "twinrate machine new --help");
  return ask_for_sheet(std::cin, std::cout);
}

// A name becomes the file NAME.toml and a line of it.
void check_name(const std::string& name) {
  const bool plain = !name.empty() && name.find_first_not_of(
                                          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                          "0123456789_-.") == std::string::npos;
  if (!plain || name[0] == '.' || name[0] == '-')
    throw BadInput(fmt::format("machine new: {}: letters, digits, _ - . allowed in a name",
                               name.empty() ? "\"\"" : name));
}

void print(const char* title, const std::vector<std::string>& lines) {
  if (lines.empty()) return;
  fmt::print("{}\n", title);
  for (const std::string& line : lines) fmt::print("  {}\n", line);
}

void make(const MachineOptions& o) {
  check_name(o.name);
  const std::string path = o.out.empty() ? o.name + ".toml" : o.out;
  expect_free(path, o.force);
  if (o.json && o.from.empty())
    throw BadInput("machine new: --json: --from key=value .. is required");
  const DriveOfSheet drive = drive_of_sheet(o.name, sheet_of(o));
  if (o.json) {
    (o.force ? replace_file : write_new)(path, drive.toml);
    const nlohmann::ordered_json json = {{"out", path},
                                         {"converted", drive.conversions},
                                         {"assumed", drive.assumed},
                                         {"derived", drive.derived},
                                         {"doubts", drive.doubts},
                                         {"warnings", drive.warnings}};
    std::cout << json.dump() << "\n";
    return;
  }
  print("converted", drive.conversions);
  print("assumed, not on the sheet", drive.assumed);
  print("derived", drive.derived);
  for (const std::string& doubt : drive.doubts) fmt::print("doubtful: {}\n", doubt);
  for (const std::string& warning : drive.warnings) fmt::print("warning: {}\n", warning);
  (o.force ? replace_file : write_new)(path, drive.toml);
  fmt::print("written to {}; next: twinrate simulate {}\n", path, path);
}

// The first comment line of a preset, which describes it.
std::string description(const std::string& preset) {
  constexpr std::size_t kMost = 84;
  std::ifstream in(preset_directory() + "/" + preset + ".toml");
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("# ")) continue;
    line = line.substr(2, line.find(". ") - 2);
    if (line.size() > kMost) return line.substr(0, line.rfind(' ', kMost)) + " ..";
    return line.ends_with(':') ? line.substr(0, line.size() - 1) : line;
  }
  return "";
}

std::string number_or_dash(double x) {
  return x > 0 ? fmt::format("{:.4g}", x) : "-";
}

void list() {
  fmt::print("{:<22} {:>4} {:>8} {:>8} {:>8}  {}\n", "preset", "n_p", "T / Nm", "rpm", "v_dc / V",
             "motor");
  for (const std::string& preset : preset_names()) {
    const DriveConfig d = load_drive(preset).drive();
    fmt::print("{:<22} {:>4} {:>8} {:>8} {:>8.4g}  {}\n", preset, d.machine.n_p,
               number_or_dash(d.machine.T_rated),
               number_or_dash(d.machine.omega_m_rated / kRadPerRpm), d.inverter.v_dc,
               description(preset));
  }
}

}  // namespace

void add_machine_verb(CLI::App& app, int&) {
  auto o = std::make_shared<MachineOptions>();
  CLI::App* machine =
      app.add_subcommand("machine", "Write the drive file of a motor; list the presets");
  machine->require_subcommand(1);
  CLI::App* verb = machine->add_subcommand("new", "Write a drive file from data-sheet values");
  verb->add_option("NAME", o->name, "give the drive this name")->required();
  verb->add_option("--from", o->from,
                   "give values of the data sheet, key=value .. (default: ask for them)");
  verb->add_option("--out", o->out, "write this file (default NAME.toml)");
  verb->add_flag("--force", o->force, "replace the file");
  verb->add_flag("--json", o->json, "print the converted, assumed and doubted values as JSON");
  verb->footer(known_keys());
  verb->callback([o] { make(*o); });
  machine->add_subcommand("list", "List the presets: ratings and motor")->callback(list);
}

}  // namespace twinrate

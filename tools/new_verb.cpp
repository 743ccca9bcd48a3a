// twinrate new: the folder of an own process, which builds and closes the loop unchanged.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/paths.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

struct NewOptions {
  std::string role, name, language = "cpp";
};

void check_folder_name(const std::string& name) {
  if (!std::regex_match(name, std::regex("[a-z][a-z0-9_]*")))
    throw BadInput(fmt::format(
        "new: NAME: small letters, digits and _ allowed, a letter first; found {}", name));
  if (fs::exists(name)) throw BadInput(name + ": is there already; choose another name");
}

std::string filled_in(std::string text, const NewOptions& o) {
  const bool cpp = o.language == "cpp";
  const std::pair<const char*, std::string> values[] = {
      {"@NAME@", o.name},
      {"@PROGRAM@", cpp ? "build/" + o.name : "./" + o.name + ".py"},
      {"@BUILD@", cpp ? "Build the process and start it with them, in a second:\n\n"
                        "    cmake -B build && cmake --build build"
                      : "Start it with them, in a second:"}};
  for (const auto& [word, value] : values)
    for (auto at = text.find(word); at != std::string::npos; at = text.find(word))
      text.replace(at, std::string_view(word).size(), value);
  return text;
}

void write_from(const fs::path& pattern, const fs::path& file, const NewOptions& o) {
  std::ifstream in(pattern);
  if (!in) throw BadInput(pattern.string() + ": not found; install the whole project");
  std::ostringstream text;
  text << in.rdbuf();
  write_new(file.string(), filled_in(text.str(), o));
}

void make_folder(const NewOptions& o) {
  check_folder_name(o.name);
  const fs::path patterns = fs::path(data_directory()) / "tools" / "new", folder = o.name;
  fs::create_directory(folder);
  write_from(patterns / (o.role + "-README.md.in"), folder / "README.md", o);
  const fs::path own = patterns / (o.role + "-" + o.language);
  if (o.language == "cpp") {
    write_from(own / "CMakeLists.txt.in", folder / "CMakeLists.txt", o);
    write_from(own / "NAME.cpp.in", folder / (o.name + ".cpp"), o);
  } else {
    const fs::path script = folder / (o.name + ".py");
    write_from(own / "NAME.py.in", script, o);
    fs::permissions(script, fs::perms::owner_exec, fs::perm_options::add);
  }
  fmt::print("written to {0}/; next: {0}/README.md\n", o.name);
}

}  // namespace

void add_new_verb(CLI::App& app, int&) {
  CLI::App* verb = app.add_subcommand("new", "Write the folder of an own process of the loop");
  verb->require_subcommand(1);
  const std::pair<const char*, const char*> roles[] = {
      {"estimator", "Write an own filter: MEASUREMENT, GAIN -> ESTIMATE"},
      {"controller", "Write an own control law: MEASUREMENT, ESTIMATE -> COMMAND"},
      {"reference", "Write an own speed reference: MEASUREMENT -> REFERENCE"}};
  for (const auto& [role, purpose] : roles) {
    auto o = std::make_shared<NewOptions>();
    o->role = role;
    CLI::App* one = verb->add_subcommand(role, purpose);
    one->add_option("NAME", o->name, "give the folder and the process this name")->required();
    one->add_option("--lang", o->language, "choose the language: cpp or python (default cpp)")
        ->check(CLI::IsMember({"cpp", "python"}));
    one->callback([o] { make_folder(*o); });
  }
}

}  // namespace twinrate

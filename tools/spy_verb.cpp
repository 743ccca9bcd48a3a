// twinrate spy: lcm-spy with the message types of the drive. Debian's lcm-spy passes flags that
// Java refuses since version 9, and knows no types.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <filesystem>

#include "core/bus.hpp"
#include "core/machine_error.hpp"
#include "core/paths.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

struct SpyOptions {
  std::string url;
  bool print = false;
};

std::string types_jar() {
  const std::string installed = data_directory() + "/lcmtypes/twinrate.jar";
  const std::string built = executable_directory() + "/../lcmtypes/twinrate.jar";
  for (const std::string& jar : {installed, built})
    if (fs::exists(jar)) return jar;
  throw MachineError(
      "spy: the types for Java were not built; as root: apt install default-jdk liblcm-java; then "
      "configure and build again");
}

std::string lcm_jars() {
  std::vector<std::string> jars;
  for (const char* name : {"lcm", "lcm-spy", "jchart2d", "xmlgraphics-commons"})
    if (const std::string jar = fmt::format("/usr/share/java/{}.jar", name); fs::exists(jar))
      jars.push_back(jar);
  for (const char* name : {"lcm", "jchart2d"})  // lcm-spy shows no fields without the second
    if (!fs::exists(fmt::format("/usr/share/java/{}.jar", name)))
      throw MachineError(fmt::format(
          "spy: {}.jar is not installed; as root: apt install liblcm-java libjchart2d-java "
          "default-jre",
          name));
  return fmt::format("{}", fmt::join(jars, ":"));
}

int spy(const SpyOptions& o) {
  const std::string url = resolve_url(o.url), path = types_jar() + ":" + lcm_jars();
  const std::vector<std::string> command = {"java",        "-Djava.net.preferIPv4Stack=true",
                                            "-Xmx128m",    "-ea",
                                            "-cp",         path,
                                            "lcm.spy.Spy", "--lcm-url=" + url};
  if (o.print) {
    fmt::print("{}\n", fmt::join(command, " "));
    return 0;
  }
  std::vector<char*> argv;
  argv.reserve(command.size() + 1);
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  execvp("java", argv.data());
  throw MachineError("spy: java is not installed; as root: apt install default-jre");
}

}  // namespace

void add_spy_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<SpyOptions>();
  CLI::App* verb = app.add_subcommand("spy", "Start lcm-spy with the message types of the drive");
  verb->add_option("--lcm-url", o->url, "use this LCM URL");
  verb->add_flag("--print", o->print, "print the command, do not start it");
  verb->callback([o, &exit_code] { exit_code = spy(*o); });
}

}  // namespace twinrate

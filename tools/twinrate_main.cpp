// The command line of twinrate. Each verb has its own file; verbs_all.cpp and verbs_simulated.cpp list them.
#include <fmt/format.h>

#include "core/command_line.hpp"
#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/paths.hpp"
#include "tools/verb.hpp"

namespace twinrate {

void refuse_absent(const std::string& what) {
  throw MachineError(fmt::format(
      "{}: not in this build, which runs simulated drives; {}/tools/build-all builds the rest",
      what, data_directory()));
}

void add_absent_verb(CLI::App& app, const char* name, const char* purpose) {
  CLI::App* verb = app.add_subcommand(name, purpose);
  verb->allow_extras()->set_help_flag();
  verb->callback([name] { refuse_absent(name); });
}

int run_verb_of(AddVerbs add_verbs, int argc, const char* const* argv) {
  remember_command(command_text(argc, argv));
  CLI::App app{"Run, record and examine PMSM drives with a two-rate Kalman filter over LCM"};
  app.set_version_flag("--version", "twinrate " + revision());
  app.require_subcommand(0, 1);
  int exit_code = 0;
  add_verbs(app, exit_code);
  expect_stated_values(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    throw BadInput(error.what());
  }
  if (app.get_subcommands().empty()) throw BadInput("a verb is required; see twinrate --help");
  return exit_code;
}

}  // namespace twinrate

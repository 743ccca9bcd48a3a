// The frame of a process's main: reads its options, runs it, turns exceptions into exit codes.
#include <fmt/format.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "core/man_page.hpp"
#include "core/option_values.hpp"
#include "core/process.hpp"
#include "core/report_error.hpp"

namespace twinrate {
namespace {

// Empty if the program ends at once, with `exit_code`.
std::optional<ProcessOptions> parse_options(const ProcessInfo& info, int argc, char** argv,
                                            int& exit_code) {
  CLI::App app{fmt::format("{}\n  {}", info.program, info.purpose)};
  ProcessOptions o;
  std::string pace = "lockstep";
  app.add_option("--config", o.config, "read this drive file or preset")->required();
  app.add_option(
      "--lcm-url", o.url,
      "use this LCM URL (default: LCM_DEFAULT_URL, else udpm://239.255.76.67:7667?ttl=0)");
  app.add_option("--set", o.overrides,
                 "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  app.add_option("--channel-suffix", o.channel_suffix, "append this text to every channel name");
  app.add_option("--session", o.session,
                 "bind to this session id; 0: adopt the first session heard")
      ->check(zero_or_more());
  app.add_option("--pace", pace, "choose the pace: lockstep, wall or realtime")
      ->check(CLI::IsMember({"lockstep", "wall", "realtime"}));
  app.add_option("--cpu", o.cpu, "pin the process to this CPU")
      ->check(CLI::Range(0, CPU_SETSIZE - 1));
  app.add_option("--helper-cpu", o.helper_cpu,
                 "lock-step: send messages that only the log needs from this CPU")
      ->check(CLI::Range(0, CPU_SETSIZE - 1));
  app.add_option(info.role == Role::kLogger ? "--out,--run-dir" : "--run-dir", o.run_dir,
                 "write files into this directory; the logger makes it");
  app.add_option(
      "--token-file", o.token_file,
      "tag messages with the token in this file, and refuse messages without such a tag");
  if (info.role >= Role::kPlant && info.role <= Role::kLogger)
    app.add_option("--shared-memory", o.shared_memory,
                   "lock-step: pass the messages of a tick through this memory of the set");
  app.add_flag("--follow", o.follow, "restart when the sequence or the session starts again");
  if (info.role == Role::kLogger)
    app.add_flag("--resume", o.resume,
                 "continue the log of a logger that ended, in the next part of its log");
  app.add_flag("--wait-for-start", o.wait_for_start, "wait for a start request");
  const auto print_man_page = [&] {
    fmt::print("{}", man_page(app, info.program));
    throw CLI::Success();
  };
  app.add_flag_callback("--man-page", print_man_page, "print the man page")->group("");
  expect_stated_values(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const bool asked_for = error.get_exit_code() == 0;  // --help
    if (!asked_for) fmt::print(stderr, "{}: {}\n", info.program, printable(error.what()));
    exit_code = asked_for ? app.exit(error) : 2;
    return {};
  }
  o.pace = pace == "realtime" ? Pace::kRealtime : Pace::kLockstep;
  o.wall = pace == "wall";
  if (!o.shared_memory.empty() && o.pace == Pace::kRealtime)
    throw BadInput("--shared-memory: lockstep, wall allowed for --pace, found realtime");
  return o;
}

}  // namespace

int run_process(const ProcessInfo& info, int argc, char** argv,
                const std::function<void(Process&)>& body) {
  int exit_code = 0;
  std::optional<ProcessOptions> options;
  try {
    expect_utf8(argc, argv);
    options = parse_options(info, argc, argv, exit_code);
  } catch (...) {
    return report_error(info.program);
  }
  if (!options) return exit_code;
  catch_stop_signals();
  try {
    Process process(info, std::move(*options));
    body(process);
    if (!process.stopping() || stop_signalled()) process.finish();
    return process.exit_code();
  } catch (...) {
    return report_error(info.program);
  }
}

}  // namespace twinrate

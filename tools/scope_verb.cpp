// twinrate scope: the live page of a drive, or of a log.
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <thread>

#include "core/authority.hpp"
#include "core/config.hpp"
#include "core/message_tag.hpp"
#include "core/process.hpp"
#include "run/progress.hpp"
#include "scope/scope.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct ScopeVerb {
  scope::ScopeOptions scope;
  std::string history = "60s";
};

double seconds_of(const std::string& option, const std::string& text) {
  const std::string seconds = seconds_text(text);
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(seconds, &used);
  } catch (const std::exception&) {
  }
  if (used != seconds.size() || !(value > 0))
    throw BadInput(fmt::format("{} {}: a time above 0 such as 60s allowed", option, text));
  return value;
}

// A drive started by launch is found by its run directory, like in twinrate set: its drive file and
// its token are there. Empty if there is none.
std::optional<RunningSet> running_set(const scope::ScopeOptions& o, const std::string& directory) {
  try {
    const RunningSet set = find_running_set(directory);
    if ((o.url.empty() || set.url == o.url) && set.channel_suffix == o.channel_suffix) return set;
  } catch (const BadInput&) {  // none is needed to watch
  }
  return {};
}

void find_drive(scope::ScopeOptions& o) {
  if (!o.log.empty()) return;
  const std::string beside =
      o.drive_file.empty() ? "" : std::filesystem::path(o.drive_file).parent_path().string();
  o.token_of = [o, beside](std::int64_t session) -> std::string {
    const auto set = running_set(o, beside);
    return set && set->session == session ? set->directory + "/" + kTokenFile : "";
  };
  if (!o.drive_file.empty()) return;
  if (const auto set = running_set(o, "")) o.drive_file = set->directory + "/config.toml";
}

int show(ScopeVerb o) {
  o.scope.history_s = seconds_of("--history", o.history);
  // The runs beside the displayed one.
  const std::filesystem::path log = std::filesystem::path(o.scope.log);
  if (!o.scope.log.empty() && std::filesystem::is_directory(log))
    o.scope.runs_directory = std::filesystem::absolute(log).lexically_normal().parent_path();
  find_drive(o.scope);
  o.scope.program = std::filesystem::read_symlink("/proc/self/exe");
  catch_stop_signals();
  scope::Scope scope(o.scope);
  fmt::print("scope: {}\n", scope.page());
  std::fflush(stdout);
  bool told = o.scope.log.empty();
  while (!stop_signalled()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (told || scope.share_read() < 1) continue;
    told = true;
    if (const std::string damage = scope.damage(); !damage.empty())
      fmt::print(stderr, "twinrate: {}\n", damage);
  }
  return 0;
}

}  // namespace

void add_scope_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<ScopeVerb>();
  CLI::App* verb = app.add_subcommand(
      "scope", "Show a running drive, or a run, on a page: curves, trigger, spectra, events");
  verb->add_option("LOG", o->scope.log, "show this run directory or log (default: the bus)");
  verb->add_option("--port", o->scope.port, "serve the page on this port (default 8080; 0: any)")
      ->check(CLI::Range(0, 65535));
  verb->add_option(
          "--listen", o->scope.address,
          "serve the page on this IPv4 address of the machine, with a token in its address "
          "(default 127.0.0.1, without)")
      ->check(CLI::ValidIPV4);
  verb->add_option("--config", o->scope.drive_file,
                   "use this drive file for a drive that was started before the scope");
  verb->add_option(
      "--runs", o->scope.runs_directory,
      "offer the runs of this directory as ghosts, and write traces there (default runs)");
  verb->add_option("--history", o->history,
                   "keep this much drive time of every tick (default 60s)");
  verb->add_option("--memory", o->scope.memory_mib,
                   "limit the memory of the history, MiB (default 512)")
      ->check(CLI::Range(16, 65536));
  verb->add_option("--lcm-url", o->scope.url, "use this LCM URL");
  verb->add_option("--channel-suffix", o->scope.channel_suffix,
                   "append this text to every channel name");
  verb->callback([o, &exit_code] { exit_code = show(*o); });
}

}  // namespace twinrate

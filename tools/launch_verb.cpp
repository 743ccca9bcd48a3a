// twinrate launch: the process set over LCM, from start to report.
#include <fmt/format.h>

#include "core/machine_error.hpp"
#include "core/multicast.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "monitor/monitor_parameters.hpp"
#include "run/supervisor.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct LaunchOptions {
  std::string drive, run_dir, duration, url, channel_suffix;
  std::string pace = "lockstep";
  std::vector<std::string> overrides;
  bool json = false, monitor = false, force = false;
};

void need_multicast() {
  if (multicast_route_exists("239.255.76.67")) return;
  std::string done;
  if (!try_bring_up_multicast(done))
    throw MachineError("no multicast route, LCM cannot work; as root: " + multicast_mend());
  fmt::print(stderr, "twinrate: {}\n", done);
}

int launch(const LaunchOptions& o) {
  std::vector<std::string> overrides = o.overrides;
  if (!o.duration.empty()) overrides.push_back("run.duration_s=" + seconds_text(o.duration));
  if (o.monitor) overrides.push_back("monitor.enabled=true");
  Config config = load_drive(o.drive, overrides);
  for (const std::string& warning : check_runnable(config))
    fmt::print(stderr, "twinrate: warning: {}\n", warning);
  const Pace pace = o.pace == "realtime" ? Pace::kRealtime : Pace::kLockstep;
  if (pace == Pace::kRealtime && config.drive().plant.delay_samples == 0)
    throw BadInput(
        fmt::format("{}: plant.delay_samples: 1 to 4 allowed with --pace realtime, found 0",
                    config.where("plant.delay_samples")));
  resolve_url(o.url);
  check_channel_suffix(o.channel_suffix);
  need_multicast();
  const auto result = make_run_directory(o.run_dir, config, o.force);
  const std::string& directory = result->path();
  catch_stop_signals();
  Supervisor supervisor(config.drive(), {.directory = directory,
                                         .url = o.url,
                                         .channel_suffix = o.channel_suffix,
                                         .pace = pace,
                                         .json = o.json,
                                         .monitor = config.read<MonitorParameters>().enabled,
                                         .bus = config.read<BusParameters>(),
                                         .on_log_loss = config.read<LoggerParameters>().on_loss});
  const RunFacts facts = supervisor.run();
  if (!facts.ended.empty()) fmt::print(stderr, "twinrate: {}\n", facts.ended);
  const int code = conclude_run(directory, config, facts);
  result->finish();
  return code;
}

}  // namespace

void add_launch_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<LaunchOptions>();
  CLI::App* verb =
      app.add_subcommand("launch", "Start, supervise and stop the process set of a drive over LCM");
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--duration", o->duration, "set the drive time, e.g. 2s or 500ms");
  verb->add_option("--pace", o->pace, "choose the pace: lockstep or realtime")
      ->check(CLI::IsMember({"lockstep", "realtime"}));
  verb->add_option("--run-dir", o->run_dir,
                   "write the run into this directory (default runs/NAME-DATE)");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_option("--lcm-url", o->url, "use this LCM URL");
  verb->add_option("--channel-suffix", o->channel_suffix, "append this text to every channel name");
  verb->add_flag("--monitor", o->monitor,
                 "start twinrate-monitor with the set (as monitor.enabled = true)");
  verb->add_flag("--force", o->force, "replace the run that the directory holds");
  verb->add_flag("--json", o->json, "print progress as JSON lines");
  verb->callback([o, &exit_code] { exit_code = launch(*o); });
}

}  // namespace twinrate

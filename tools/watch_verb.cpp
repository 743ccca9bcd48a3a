// twinrate watch: a live view of the bus.
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>

#include "core/bus.hpp"
#include "core/config.hpp"
#include "core/process.hpp"
#include "run/progress.hpp"
#include "tools/verb.hpp"
#include "tools/watch/view.hpp"

namespace twinrate {
namespace {

struct WatchOptions {
  std::string url, channel_suffix, duration, until_ready;
  bool once = false, json = false;
};

// Prints the view: in place on a terminal, else one block or JSON line a second.
class Screen {
 public:
  explicit Screen(const WatchOptions& options)
      : json_(options.json), in_place_(!options.json && !options.once && isatty(STDOUT_FILENO)) {}

  double period_s() const { return in_place_ ? 0.25 : 1.0; }

  void show(const Watcher& watcher, const std::string& url) {
    if (json_) {
      fmt::print("{}\n", view_json(watcher, url));
    } else if (in_place_) {
      redraw(view_text(watcher, url, terminal_width()));
    } else {
      print_plain(watcher, url);
    }
    std::fflush(stdout);
  }

 private:
  static std::size_t terminal_width() {
    winsize size{};
    const bool known = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 20;
    return known ? size.ws_col - 1u : 0u;
  }
  // Prints only after new messages; reports a silence once.
  void print_plain(const Watcher& watcher, const std::string& url) {
    const std::string silence = silence_text(watcher, url);
    if (!silence.empty() && !said_silence_)
      fmt::print("{}\n", silence);
    else if (watcher.heard() > heard_)
      fmt::print("{}", view_text(watcher, url, 0));
    said_silence_ = !silence.empty();
    heard_ = watcher.heard();
  }
  void redraw(const std::string& text) {
    if (lines_ > 0) fmt::print("\033[{}A\033[J", lines_);
    fmt::print("{}", text);
    lines_ = std::count(text.begin(), text.end(), '\n');
  }

  bool json_, in_place_, said_silence_ = false;
  std::int64_t heard_ = 0;
  std::ptrdiff_t lines_ = 0;
};

// Duration in s; 0: until Ctrl-C.
double duration_of(const WatchOptions& options) {
  if (options.duration.empty()) return options.once ? 1.0 : 0.0;
  const std::string text = seconds_text(options.duration);
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc() || end != text.data() + text.size() || !(seconds > 0))
    throw BadInput(
        fmt::format("--duration {}: a time above 0 such as 5s or 500ms allowed", options.duration));
  return seconds;
}

double since_s(std::int64_t then_us) {
  return 1e-6 * static_cast<double>(wall_clock_us() - then_us);
}

void begin_interval(Watcher& watcher) {
  const std::int64_t now_us = wall_clock_us();
  for (WatchedChannel& account : watcher.channels()) account.begin_interval(now_us);
}

// One view: `duration_s` from the first message on; waits at most 3 s for it.
void watch_once(Watcher& watcher, Screen& screen, const std::string& url, double duration_s) {
  const std::int64_t waiting_since_us = wall_clock_us();
  while (!stop_signalled() && watcher.heard() == 0 && since_s(waiting_since_us) < 3)
    watcher.listen(20);
  const std::int64_t first_us = wall_clock_us();
  begin_interval(watcher);
  while (!stop_signalled() && watcher.heard() > 0 && since_s(first_us) < duration_s)
    watcher.listen(20);
  screen.show(watcher, url);
}

void watch_on(Watcher& watcher, Screen& screen, const std::string& url, double duration_s) {
  const std::int64_t start_us = wall_clock_us();
  std::int64_t shown_us = start_us;
  begin_interval(watcher);
  for (bool over = false; !over;) {
    watcher.listen(20);
    over = stop_signalled() || (duration_s > 0 && since_s(start_us) >= duration_s);
    if (!over && since_s(shown_us) < screen.period_s()) continue;
    screen.show(watcher, url);
    shown_us = wall_clock_us();
    begin_interval(watcher);
  }
}

// The wanted roles that are not ready; "" if all are.
std::string not_ready(const Watcher& watcher, const std::vector<std::string>& wanted) {
  std::string missing;
  for (const std::string& role : wanted) {
    const bool ready = std::any_of(
        watcher.processes().begin(), watcher.processes().end(), [&](const auto& process) {
          return role == role_name(process.first) &&
                 process.second.state >= static_cast<int>(ProcessState::kReady);
        });
    if (!ready) missing += (missing.empty() ? "" : ", ") + role;
  }
  return missing;
}

// For scripts: waits for the heartbeats of the wanted processes.

int wait_until_ready(Watcher& watcher, const WatchOptions& options) {
  const std::vector<std::string> wanted = CLI::detail::split(options.until_ready, ',');
  for (const std::string& role : wanted)
    if (std::find(std::begin(kRoleNames), std::end(kRoleNames), role) == std::end(kRoleNames))
      throw BadInput(
          fmt::format("--until-ready {}: one of {} allowed", role, fmt::join(kRoleNames, ", ")));
  const double patience_s = options.duration.empty() ? 10 : duration_of(options);
  const std::int64_t start_us = wall_clock_us();
  while (!not_ready(watcher, wanted).empty()) {
    if (stop_signalled() || since_s(start_us) > patience_s) {
      fmt::print(stderr, "twinrate: not ready after {} s: {}\n", patience_s,
                 not_ready(watcher, wanted));
      return 1;
    }
    watcher.listen(20);
  }
  return 0;
}

int watch(const WatchOptions& options) {
  const double duration_s = duration_of(options);
  const std::string url = resolve_url(options.url);
  check_channel_suffix(options.channel_suffix);
  catch_stop_signals();
  Watcher watcher(url, options.channel_suffix);
  if (!options.until_ready.empty()) return wait_until_ready(watcher, options);
  Screen screen(options);
  if (options.once)
    watch_once(watcher, screen, url, duration_s);
  else
    watch_on(watcher, screen, url, duration_s);
  return watcher.heard() > 0 || stop_signalled() ? 0 : 1;
}

}  // namespace

void add_watch_verb(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<WatchOptions>();
  auto* verb = app.add_subcommand(
      "watch", "Show the channels of a running drive: rates, gaps, latency, values");
  verb->add_option("--lcm-url", options->url, "use this LCM URL");
  verb->add_option("--channel-suffix", options->channel_suffix,
                   "append this text to every channel name");
  verb->add_option("--duration", options->duration, "stop after this time, e.g. 5s or 500ms");
  verb->add_option("--until-ready", options->until_ready,
                   "wait for the heartbeats of these processes, e.g. estimator,gain (at most for "
                   "--duration, 10 s)");
  verb->add_flag("--once", options->once,
                 "show one table, a second after the first message, and exit");
  verb->add_flag("--json", options->json, "print one JSON line per second");
  verb->callback([options, &exit_code] { exit_code = watch(*options); });
}

}  // namespace twinrate

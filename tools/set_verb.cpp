// twinrate set: steers a running drive; --save: writes a steered run as a drive file.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/drive_hand.hpp"
#include "core/output_file.hpp"
#include "core/reason.hpp"
#include "core/report_error.hpp"
#include "core/run_log.hpp"
#include "core/steering.hpp"
#include "loop/lcm_replay.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct SetOptions {
  std::vector<std::string> lines;
  std::string run_dir, url, channel_suffix, save, add_effects, remove_effects;
  std::int64_t tick = 0;
  bool force = false, json = false;
};

RunningSet set_of(const SetOptions& o) {
  if (o.run_dir.empty() && (!o.url.empty() || !o.channel_suffix.empty()))
    return {.directory = "", .url = o.url, .channel_suffix = o.channel_suffix};
  return find_running_set(o.run_dir);
}

// The [[effect]] tables of a file.
std::string effects_in(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw BadInput(file + ": cannot be read");
  const std::string text = {std::istreambuf_iterator<char>(in), {}};
  Config::check_addition(text, file);
  return text;
}

HandAnswer ask(DriveHand& hand, const SetOptions& o) {
  if (!o.add_effects.empty())
    return hand.ask(RequestKind::kAddEffect, effects_in(o.add_effects), o.tick);
  if (!o.remove_effects.empty())
    return hand.ask(RequestKind::kRemoveEffect, effects_in(o.remove_effects), o.tick);
  for (const char* alone : {"emergency_stop", "reset"})
    if (std::find(o.lines.begin(), o.lines.end(), alone) != o.lines.end() &&
        (o.lines.size() > 1 || o.tick > 0))
      throw BadInput(fmt::format("{}: alone and without --tick allowed", alone));
  if (o.lines.front() == "emergency_stop") return hand.emergency_stop();
  if (o.lines.front() == "reset") return hand.reset();
  return hand.steer(fmt::format("{}", fmt::join(o.lines, "\n")), o.tick);
}

// The request in the words of the answer.
std::string told(const SetOptions& o) {
  if (!o.add_effects.empty()) return "with the effects of " + o.add_effects;
  if (!o.remove_effects.empty()) return "without the effects of " + o.remove_effects;
  return fmt::format("{}", fmt::join(o.lines, ", "));
}

int steer(const SetOptions& o) {
  const int asked = !o.lines.empty() + !o.add_effects.empty() + !o.remove_effects.empty();
  if (asked == 0)
    throw BadInput(
        "nothing to set: KEY=VALUE, start, stop, emergency_stop, reset, --add-effects or "
        "--remove-effects allowed");
  if (asked > 1)
    throw BadInput("KEY=VALUE, --add-effects and --remove-effects: one of them at a time allowed");
  DriveHand hand(set_of(o));
  const HandAnswer answer = ask(hand, o);
  if (o.json) {
    nlohmann::json line = {{"accepted", answer.accepted}, {"asked", told(o)}};
    if (answer.accepted)
      line["tick"] = answer.k, line["t_ns"] = answer.t_ns;
    else
      line["why"] = printable(answer.why);
    fmt::print("{}\n", line.dump());
    return answer.accepted ? 0 : answer.answered ? 2 : 1;
  }
  if (answer.accepted) {
    fmt::print("tick {} ({:.4f} s): {}\n", answer.k, 1e-9 * static_cast<double>(answer.t_ns),
               told(o));
    return 0;
  }
  fmt::print(stderr, "twinrate: {}\n", printable(answer.why));
  return answer.answered ? 2 : 1;
}

int save(const SetOptions& o) {
  if (!o.lines.empty()) throw BadInput("--save: without KEY=VALUE allowed");
  if (o.run_dir.empty()) throw BadInput("--save: needs the directory of the run: --run-dir DIR");
  expect_free(o.save, o.force);
  const RunLog log = read_run_log(o.run_dir);
  if (log.config_toml.empty() || log.command.empty())
    throw BadInput(o.run_dir + ": its log holds no drive file");
  const std::string text = steered_drive_file(log);
  PartFile file(o.save);
  std::FILE* out = std::fopen(file.part_path().c_str(), "w");
  if (!out || std::fputs(text.c_str(), out) < 0 || std::fclose(out) != 0) file.fail();
  file.finish();
  const std::vector<AppliedSteering> requests = steering_in(log);
  std::size_t applied = 0;
  for (std::size_t i = 0; i < requests.size(); ++i)
    applied += why_not_applied(requests, i, whole_ticks(log) - 1).empty();
  fmt::print("{}: {} requests as profiles, {} changes of the model, {} ticks\n", o.save, applied,
             model_changes_in(log).size(), whole_ticks(log));
  return 0;
}

}  // namespace

void add_set_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<SetOptions>();
  CLI::App* verb = app.add_subcommand(
      "set", "Steer a running drive: all processes apply the request at one tick");
  verb->add_option(
      "KEY=VALUE", o->lines,
      "set speed_rpm, omega_e_rad_s, load_Nm, n, policy or compensation to a value; or send "
      "start, stop, emergency_stop or reset");
  verb->add_option("--add-effects", o->add_effects,
                   "add the [[effect]] tables of this file to the running model")
      ->check(CLI::ExistingFile);
  verb->add_option(
          "--remove-effects", o->remove_effects,
          "remove the [[effect]] tables of this file, as they were added, from the running model")
      ->check(CLI::ExistingFile);
  verb->add_option("--tick", o->tick, "apply at this tick (default: the next one)")
      ->check(zero_or_more());
  verb->add_option("--run-dir", o->run_dir,
                   "steer the run of this directory (default: the newest running one in runs/)");
  verb->add_option("--lcm-url", o->url, "steer the drive on this LCM URL");
  verb->add_option("--channel-suffix", o->channel_suffix, "append this text to every channel name");
  verb->add_option("--save", o->save,
                   "write the steered run in --run-dir as a drive file that repeats it");
  verb->add_flag("--force", o->force, "with --save: replace the file");
  verb->add_flag("--json", o->json, "print the answer to a request as a JSON line")
      ->excludes("--save");
  verb->callback([o, &exit_code] { exit_code = o->save.empty() ? steer(*o) : save(*o); });
}

}  // namespace twinrate

// twinrate report RUN_DIR|LOG..: writes one HTML page.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "analysis/long_log.hpp"
#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/percent_line.hpp"
#include "core/run_log_part.hpp"
#include "report/report.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

struct ReportArguments {
  std::vector<std::string> paths, notes;
  std::string out, title, config, angle_reference = "auto", channel_suffix;
  bool force = false, repair = false, json = false;
};

struct LoadedRun {
  RunLog log;
  RunTicks ticks;
  Config config;
  Summary summary;
  std::string manifest_json;
};

std::string text_of(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// A file of the run: in the run directory, or in the directory of log.lcm.
fs::path beside(const fs::path& path, const char* name) {
  if (fs::is_directory(path)) return path / name;
  return path.filename() == "log.lcm" ? path.parent_path() / name : fs::path();
}

// The config in the log; for a log without one, the given file or the one beside the log.
Config config_of(const RunLog& log, const std::string& given) {
  if (!given.empty()) return Config::load(given);
  if (!log.config_toml.empty()) return Config::parse(log.config_toml, log.path + " (config)");
  const fs::path file = beside(log.path, "config.toml");
  if (fs::is_regular_file(file)) return Config::load(file.string());
  throw BadInput(
      fmt::format("{}: holds no config (DRIVE_MANIFEST); give one with --config", log.path));
}

AngleReference wanted_reference(const std::string& name) {
  if (name == "truth") return AngleReference::kTruth;
  return name == "encoder" ? AngleReference::kEncoder : AngleReference::kAuto;
}

// Of a long log its events and drive file: load() then reads its figures tick by tick.
RunLog read_as_needed(const std::string& path, const ReportArguments& arguments, bool all_ticks) {
  const OnDamage on_damage = arguments.repair ? OnDamage::kSkip : OnDamage::kRefuse;
  return all_ticks ? read_run_log(path, arguments.channel_suffix, on_damage)
                   : scan_run_log(path, arguments.channel_suffix, on_damage,
                                  [](Channel, const lcm::LogEvent&) {});
}

LoadedRun load(const std::string& path, const ReportArguments& arguments) {
  const bool all_ticks = !is_long(path);
  RunLog log = read_as_needed(path, arguments, all_ticks);
  if (!log.damage.empty()) fmt::print(stderr, "twinrate: {}\n", log.damage);
  Config config = config_of(log, arguments.config);
  const AngleReference wanted = wanted_reference(arguments.angle_reference);
  Summary summary;
  RunTicks ticks;
  if (all_ticks) {
    ticks = run_ticks(log);
  } else {
    LongLog found =
        summarise_log(path, config.drive(), arguments.repair ? OnDamage::kSkip : OnDamage::kRefuse,
                      kTicksShown, wanted, arguments.channel_suffix);
    summary = found.summary;
    summary.window_from_s = window_of_part(found);
    log = std::move(found.log);
    ticks = std::move(found.ticks);
    log.path += fmt::format(" (curves: ticks {} to {})", found.first_k, found.last_k);
  }
  if (wanted != AngleReference::kAuto && ticks.outline.resolve(wanted) == AngleReference::kNone)
    throw BadInput(
        fmt::format("{}: --angle-reference {}: the log has no such angle; omit the option to use "
                    "the available one",
                    path, arguments.angle_reference));
  if (all_ticks) summary = summarise(log, ticks, config.drive(), wanted);
  take_process_figures(text_of(beside(path, "summary.json")), summary);
  return {std::move(log), std::move(ticks), std::move(config), std::move(summary),
          text_of(beside(path, "manifest.json"))};
}

// RUN_DIR/report.html, LOG.html beside a log file, or the current directory for a comparison.
std::string default_out(const std::vector<std::string>& paths) {
  if (paths.size() > 1) return "comparison.html";
  const fs::path path = paths.front();
  return fs::is_directory(path) ? (path / "report.html").string()
                                : fs::path(path).replace_extension(".html").string();
}

void expect_other_file(const std::string& out, const std::string& log) {
  std::error_code error;
  if (fs::equivalent(out, log, error))
    throw BadInput(fmt::format("{}: is the log itself; --out takes another name", out));
}

// Exit code.
int report(const ReportArguments& arguments) {
  const std::string out = arguments.out.empty() ? default_out(arguments.paths) : arguments.out;
  for (const std::string& path : arguments.paths) expect_other_file(out, path);
  expect_free(out, arguments.force);
  std::vector<LoadedRun> loaded;
  loaded.reserve(arguments.paths.size());
  {
    PercentLine line(arguments.json ? PercentLine::Form::kJson : PercentLine::Form::kTerminal);
    for (const std::string& path : arguments.paths) {
      line.show("reading " + path,
                static_cast<double>(loaded.size()) / static_cast<double>(arguments.paths.size()));
      loaded.push_back(load(path, arguments));
    }
  }
  std::vector<ReportRun> runs;
  runs.reserve(loaded.size());
  for (const LoadedRun& run : loaded)
    runs.push_back({run.log, run.ticks, run.config.drive(), run.summary, run.manifest_json});
  write_report(
      runs, {arguments.title, wanted_reference(arguments.angle_reference), arguments.notes}, out);
  if (arguments.json)
    fmt::print("{}\n", nlohmann::json{{"page", out}}.dump());
  else
    fmt::print("{}\n", out);
  const bool whole = std::all_of(loaded.begin(), loaded.end(),
                                 [](const LoadedRun& run) { return run.log.damage.empty(); });
  return whole ? 0 : 1;
}

}  // namespace

void add_report_verb(CLI::App& app, int& exit_code) {
  auto arguments = std::make_shared<ReportArguments>();
  CLI::App* verb = app.add_subcommand(
      "report", "Write one self-contained HTML page of figures; compare several runs");
  verb->add_option("LOG", arguments->paths, "read these run directories or log files")->required();
  verb->add_option("--out", arguments->out, "write this page (default RUN_DIR/report.html)");
  verb->add_option("--note", arguments->notes,
                   "write this line under the heading; repeat for more lines")
      ->allow_extra_args(false);
  verb->add_option("--title", arguments->title, "set the heading (default: the name of the drive)");
  verb->add_option("--angle-reference", arguments->angle_reference,
                   "choose the reference of the angle error: truth, or encoder for the measured "
                   "position (default: truth if the log has it)")
      ->check(CLI::IsMember({"auto", "truth", "encoder"}));
  verb->add_option("--config", arguments->config, "read this drive file for a log without one");
  verb->add_option("--channel-suffix", arguments->channel_suffix,
                   "read the channels with this suffix");
  verb->add_flag("--repair", arguments->repair, "use the undamaged part of a log; exit code 1");
  verb->add_flag("--force", arguments->force, "replace the page of --out");
  verb->add_flag("--json", arguments->json, "print JSON lines instead of text");
  verb->callback([arguments, &exit_code] { exit_code = report(*arguments); });
}

}  // namespace twinrate

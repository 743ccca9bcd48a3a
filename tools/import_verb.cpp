// twinrate import FILE --map MAP.toml --out LOG: converts a measured CSV or MATLAB file to an LCM log.
// It warns of units that do not fit the drive.
// twinrate import FILE --guess --out MAP.toml: writes a map from the header of the file.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/output_file.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "drive_log/log_reader.hpp"
#include "import/drive_rows.hpp"
#include "import/exported_log.hpp"
#include "import/guess.hpp"
#include "import/import_log.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"
#include "trace/consistency.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

struct ImportOptions {
  std::string file, map, out, drive, from;
  std::vector<std::string> overrides;
  bool repair = false, json = false, force = false, guess = false;
};

std::string tick_text(const Json& s) {
  const std::int64_t gaps = s["gaps"], moved = s["moved_rows"], left_out = s["crowded_out_rows"];
  std::string text =
      gaps == 0 ? "none empty"
                : fmt::format("{} empty in {} gaps", s["missing_ticks"].get<std::int64_t>(), gaps);
  if (moved > 0) text += fmt::format("; {} rows moved to a neighbouring tick", moved);
  if (left_out > 0) text += fmt::format("; {} rows left out, their tick has another row", left_out);
  return text;
}

void print_result(const ImportOptions& o, const Json& s, bool time_fits) {
  const auto list = [](const Json& items) {
    std::string text;
    for (const auto& item : items) text += (text.empty() ? "" : ", ") + item.get<std::string>();
    return text.empty() ? std::string("nothing") : text;
  };
  const double f_s = s["f_s_Hz"], median = s["dt_median_s"];
  fmt::print("{}: {} rows, {:.6g} s\n", o.out, s["rows"].get<std::size_t>(),
             s["duration_s"].get<double>());
  fmt::print("  signals   {}\n  left out  {}\n", list(s["signals"]), list(s["left_out"]));
  fmt::print("  timing    dt {:.4g} / {:.4g} / {:.4g} ms (min, median, max), ticks of {} Hz\n",
             1e3 * s["dt_min_s"].get<double>(), 1e3 * median, 1e3 * s["dt_max_s"].get<double>(),
             f_s);
  fmt::print("  ticks     {}\n", tick_text(s));
  for (const auto& note : s["notes"]) fmt::print("  note      {}\n", note.get<std::string>());
  if (median * f_s > 1.5 && time_fits)
    fmt::print(
        "warning: the samples are {:.3g} ticks of {} Hz apart; use --set rates.f_s_Hz={:.6g} for a "
        "log without gaps\n",
        median * f_s, f_s, 1 / median);
  for (const auto& text : s["warnings"]) fmt::print("warning: {}\n", text.get<std::string>());
}

// Units and conventions of the file that do not fit the drive.
struct UnitCheck {
  std::vector<std::string> warnings;  // one line each
  bool time_fits = true;
};
// As `trace` finds them, of the first rows.
UnitCheck check_units(const ImportOptions& o, const ImportMap& map, const DriveConfig& drive) {
  constexpr std::size_t kRows = 50'000;
  UnitCheck check;
  try {
    const auto log =
        open_log(o.file, o.map.empty() ? nullptr : &map, o.repair, drive.inverter.v_dc);
    RawLog raw;
    log->next(raw, kRows);
    if (log->may_wrap()) unwrap_turns(raw.theta_m);
    Health health;
    const Record record = make_record(raw, drive.machine.n_p, health, drive.sensors.encoder_counts);
    const std::vector<Inconsistency> found =
        inconsistencies(record, health, drive.facts(), drive.sensors.encoder_counts);
    if (std::string why = hidden_turns(record, health, drive.facts(), found); !why.empty()) {
      check.warnings.push_back(std::move(why));
      return check;
    }
    for (const Inconsistency& i : found) {
      check.warnings.push_back(inconsistency_in_words(i));
      check.time_fits = check.time_fits && i.quantity != "t";
    }
  } catch (const BadInput& error) {
    check.warnings.push_back(fmt::format("units are not checked: {}", error.what()));
  }
  return check;
}

Config drive_of(const ImportOptions& o, const ImportMap& map) {
  if (!o.drive.empty()) return load_drive(o.drive, o.overrides);
  if (map.preset.empty())
    throw BadInput(fmt::format(
        "{}: no drive: give --drive DRIVE.toml or [drive] preset in the map; presets: {}",
        o.map.empty() ? o.file : o.map, fmt::join(preset_names(), ", ")));
  try {
    return load_drive(map.preset, o.overrides);
  } catch (const BadInput& error) {
    throw BadInput(fmt::format("{}: drive.preset: {}", map.preset_where, error.what()));
  }
}

void expect_other_file(const std::string& out, const std::string& input) {
  std::error_code error;
  if (std::filesystem::equivalent(out, input, error))
    throw BadInput(fmt::format("{}: is an input; --out takes another name", out));
}

Json json_of(const ImportOptions& o, const Guess& guess) {
  Json columns = Json::array();
  for (const GuessedColumn& c : guess.columns) {
    Json json = {{"column", c.number}, {"name", c.name}};
    if (c.canonical.empty())
      json["not_understood"] = c.reason;
    else
      json.update({{"is", c.canonical},
                   {"scale", c.scale},
                   {"offset", c.offset},
                   {"unit_from", c.unit_from}});
    columns.push_back(json);
  }
  return {{"out", o.out}, {"tool", guess.tool}, {"columns", columns}, {"notes", guess.notes}};
}

void print_guess(const ImportOptions& o, const Guess& guess) {
  fmt::print("{}: a map of {}{}\n", o.out, o.file,
             guess.tool.empty() ? "" : fmt::format(", a log of {}", guess.tool));
  for (const GuessedColumn& c : guess.columns)
    if (!c.canonical.empty())
      fmt::print("  {:<12} from {}{}: {}\n", c.canonical, c.name,
                 c.scale == 1 ? "" : fmt::format(" times {:.6g}", c.scale), c.unit_from);
  for (const GuessedColumn& c : guess.columns)
    if (c.canonical.empty()) fmt::print("  not understood: {}: {}\n", c.name, c.reason);
  for (const std::string& note : guess.notes) fmt::print("  note: {}\n", note);
}

void guess(const ImportOptions& o) {
  expect_other_file(o.out, o.file);
  expect_free(o.out, o.force);
  if (!o.map.empty()) throw BadInput("--guess writes a map; --map is not allowed with it");
  GuessRequest request{.file = o.file, .tool = o.from};
  std::string preset;
  if (!o.drive.empty()) {
    request.n_p = load_drive(o.drive, o.overrides).drive().machine.n_p;
    const auto presets = preset_names();
    if (std::find(presets.begin(), presets.end(), o.drive) != presets.end()) preset = o.drive;
  }
  const Guess guess = guess_map(request);
  PartFile part(o.out);
  if (!(std::ofstream(part.part_path()) << map_toml(guess, preset) << std::flush)) part.fail();
  part.finish();
  if (o.json)
    std::cout << json_of(o, guess).dump() << "\n";
  else
    print_guess(o, guess);
}

void import_export(const ImportOptions& o) {
  if (!o.drive.empty() || !o.overrides.empty())
    throw BadInput(
        fmt::format("{}: a log with its drive file; --drive and --set are not allowed", o.file));
  expect_free(o.out, o.force);
  PercentLine line(o.json ? PercentLine::Form::kNone : PercentLine::Form::kTerminal);
  const auto counts =
      import_exported_log(o.file, o.out, [&](double share) { line.show("reading", share); });
  line.clear();
  if (o.json) {
    std::cout << Json{{"file", o.file}, {"out", o.out}, {"messages", counts}}.dump() << "\n";
    return;
  }
  fmt::print("{}: the log that {} was exported from\n", o.out, o.file);
  for (const auto& [name, count] : counts) fmt::print("  {:<12} {:>9} messages\n", name, count);
}

void import(const ImportOptions& o) {
  catch_stop_signals();
  expect_other_file(o.out, o.file);
  if (o.map.empty() && is_exported_log(o.file)) return import_export(o);
  if (!o.map.empty()) expect_other_file(o.out, o.map);
  expect_free(o.out, o.force);
  const ImportMap map = o.map.empty() ? ImportMap{} : read_import_map(o.map);
  const Config config = drive_of(o, map);
  PercentLine line(o.json ? PercentLine::Form::kNone : PercentLine::Form::kTerminal);
  Json source =
      import_log({.file = o.file, .map = o.map, .out = o.out, .repair = o.repair}, map, config,
                 [&](const std::string& what, double share) { line.show(what, share); });
  line.clear();
  const UnitCheck units = check_units(o, map, config.drive());
  source["warnings"] = units.warnings;
  if (o.json)
    std::cout << source.dump() << "\n";
  else
    print_result(o, source, units.time_fits);
}

}  // namespace

void add_import_verb(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<ImportOptions>();
  auto* verb = app.add_subcommand("import", "Convert a measured file into an LCM log");
  verb->add_option("file", options->file, "read this CSV (plain or gzipped), .mat or .mcap file")
      ->required();
  verb->add_option("--map", options->map,
                   "read the columns through this map (default: the header has canonical names)");
  verb->add_option("--out", options->out, "write this log; with --guess, this map")->required();
  verb->add_flag("--guess", options->guess,
                 "write a map from the header; list the columns with and without a meaning");
  verb->add_option("--from", options->from,
                   "take the columns as this tool writes them: vesc, odrive, moteus, simplefoc or "
                   "matlab (default: by the header)")
      ->needs("--guess");
  verb->add_option("--drive", options->drive,
                   "use this drive file or preset instead of the one of the map");
  verb->add_option("--set", options->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false)
      ->take_all();
  verb->add_flag("--repair", options->repair, "skip a truncated last line and repeated samples");
  verb->add_flag("--force", options->force, "replace the log of --out");
  verb->add_flag("--json", options->json, "print the result as one line of JSON");
  verb->callback([options, &exit_code] {
    try {
      options->guess ? guess(*options) : import(*options);
    } catch (const Stopped&) {  // a partial log is not written
      fmt::print(stderr, "twinrate: import stopped, nothing written\n");
      exit_code = 1;
    }
  });
}

}  // namespace twinrate

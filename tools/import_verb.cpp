// twinrate import FILE --map MAP.toml --out LOG: converts a measured CSV to an LCM log.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/manifest.hpp"
#include "core/paths.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "import/drive_messages.hpp"
#include "import/whole_log.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

struct ImportOptions {
  std::string file, map, out, drive;
  std::vector<std::string> overrides;
  bool repair = false, json = false;
};

Json describe(const ImportOptions& o, const DriveRows& rows, const TickGrid& grid,
              const DriveMessages& messages, double f_s_Hz) {
  std::vector<std::string> left_out = rows.left_out;
  for (const std::string& name : messages.no_place()) left_out.push_back(name);
  const auto path = std::filesystem::path(o.file);
  return {{"file", path.filename().string()},
          {"bytes", std::filesystem::file_size(path)},
          {"fnv1a64", file_hash(o.file)},
          {"map", o.map.empty() ? "" : std::filesystem::path(o.map).filename().string()},
          {"rows", rows.size()},
          {"t_0_s", rows.t.front()},
          {"duration_s", rows.t.back() - rows.t.front()},
          {"f_s_Hz", f_s_Hz},
          {"dt_min_s", grid.dt_min_s},
          {"dt_median_s", grid.dt_median_s},
          {"dt_max_s", grid.dt_max_s},
          {"gaps", grid.gaps},
          {"missing_ticks", grid.missing},
          {"moved_rows", grid.moved},
          {"crowded_out_rows", grid.crowded_out},
          {"signals", messages.found()},
          {"left_out", left_out},
          {"notes", rows.notes}};
}

std::string manifest_json(std::int64_t session, const Json& source, const std::string& map_toml) {
  const Json json = {{"program", "twinrate import"},
                     {"revision", revision()},
                     {"session", session},
                     {"source", source},
                     {"map_toml", map_toml}};
  return json.dump(2);
}

void write_log(const ImportOptions& o, const TickGrid& grid, const DriveMessages& messages,
               manifest_t manifest, PercentLine& line) {
  constexpr std::int64_t kFirst_us =
      1'000'000;  // event times start at 1 s: 0 would mean "not known"
  const std::int64_t session = manifest.session;
  WholeLog log(o.out);
  log.write(manifest, kFirst_us);
  for (std::size_t i = 0; i < grid.slots.size(); ++i) {
    const Measurement m = messages.measurement(grid.slots[i]);
    const std::int64_t t_us = kFirst_us + m.t_ns / 1000;
    log.write(to_wire(m, session), t_us);
    if (messages.has_reference())
      log.write(to_wire(messages.reference(grid.slots[i]), session), t_us);
    if (i % 16384 == 0)
      line.show("writing", static_cast<double>(i) / static_cast<double>(grid.slots.size()));
  }
  log.finish();
}

std::string tick_text(const Json& s) {
  const std::int64_t gaps = s["gaps"], moved = s["moved_rows"], left_out = s["crowded_out_rows"];
  std::string text =
      gaps == 0 ? "none empty"
                : fmt::format("{} empty in {} gaps", s["missing_ticks"].get<std::int64_t>(), gaps);
  if (moved > 0) text += fmt::format("; {} rows moved to a neighbouring tick", moved);
  if (left_out > 0) text += fmt::format("; {} rows left out, their tick has another row", left_out);
  return text;
}

void print_result(const ImportOptions& o, const Json& s) {
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
  if (median * f_s > 1.5)
    fmt::print(
        "warning: the samples are {:.3g} ticks of {} Hz apart; use --set rates.f_s_Hz={:.6g} for a "
        "log without gaps\n",
        median * f_s, f_s, 1 / median);
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

void import(const ImportOptions& o) {
  catch_stop_signals();
  const ImportMap map = o.map.empty() ? ImportMap{} : read_import_map(o.map);
  const Config config = drive_of(o, map);
  const DriveConfig& drive = config.drive();
  PercentLine line(o.json ? PercentLine::Form::kNone : PercentLine::Form::kTerminal);
  const DriveRows rows = read_drive_rows(o.file, o.map.empty() ? nullptr : &map, o.repair,
                                         [&](double share) { line.show("reading", share); });
  const TickGrid grid = place_on_grid(rows, drive.rates.f_s_Hz);
  const DriveMessages messages(rows, drive.machine.n_p, drive.inverter.v_dc);
  const Json source = describe(o, rows, grid, messages, drive.rates.f_s_Hz);
  const std::string hash = source["fnv1a64"];
  const auto session = static_cast<std::int64_t>(std::stoull(hash, nullptr, 16) >> 1 | 1);
  write_log(o, grid, messages,
            make_manifest(session, config.resolved(), manifest_json(session, source, map.toml)),
            line);
  line.clear();
  if (o.json)
    std::cout << source.dump() << "\n";
  else
    print_result(o, source);
}

}  // namespace

void add_import_verb(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<ImportOptions>();
  auto* verb = app.add_subcommand("import", "Convert a measured CSV into an LCM log");
  verb->add_option("file", options->file, "read this CSV file, plain or gzipped")->required();
  verb->add_option("--map", options->map,
                   "read the columns through this map (default: the header has canonical names)");
  verb->add_option("--out", options->out, "write this log")->required();
  verb->add_option("--drive", options->drive,
                   "use this drive file or preset instead of the one of the map");
  verb->add_option("--set", options->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false)
      ->take_all();
  verb->add_flag("--repair", options->repair, "skip a truncated last line and repeated samples");
  verb->add_flag("--json", options->json, "print the result as one line of JSON");
  verb->callback([options, &exit_code] {
    try {
      import(*options);
    } catch (const Stopped&) {  // a partial log is not written
      fmt::print(stderr, "twinrate: import stopped, nothing written\n");
      exit_code = 1;
    }
  });
}

}  // namespace twinrate

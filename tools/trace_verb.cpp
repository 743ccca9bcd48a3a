// twinrate trace: residual -> named effect -> extended model -> error before and after.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>

#include "core/paths.hpp"
#include "core/process.hpp"
#include "core/run_log.hpp"
#include "tools/load_drive.hpp"
#include "tools/report/trace_page.hpp"
#include "tools/trace/extended.hpp"
#include "tools/trace/measured_files.hpp"
#include "tools/trace/plan_verb.hpp"
#include "tools/trace/raw_log.hpp"
#include "tools/trace/verify.hpp"
#include "tools/verb.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

struct TraceOptions {
  std::string drive, out = "trace", url;
  std::vector<std::string> data, holdout, overrides, maps;
  bool repair = false, json = false, verbose = false, keep_plant = false, verify = false;
  PlanOptions plan;
};

// A share of the rows, or empty where `text` is not a number.
std::optional<double> fraction(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return {};
  if (!(value > 0 && value < 0.9))
    throw BadInput(fmt::format("--holdout {}: a share between 0 and 0.9, or files", text));
  return value;
}

void write(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (!file.flush()) throw BadInput(path + ": cannot be written");
}

// `measurements`: filled where it is not null.
Record read_record(const TraceOptions& o, const std::string& path, const DriveConfig& drive,
                   Health& health, std::vector<std::string>& notes,
                   std::vector<Measurement>* measurements) {
  RawLog raw;
  if (is_run_log(path)) {
    raw = raw_log_of_run(path);
    if (measurements) *measurements = read_run_log(path).measurement;
  } else {
    const std::optional<ImportMap> map = map_for(path, o.maps);
    DriveRows rows = read_drive_rows(path, map ? &*map : nullptr, o.repair);
    notes.insert(notes.end(), rows.notes.begin(), rows.notes.end());
    if (measurements) *measurements = measurements_of(rows, drive);
    raw = raw_log(std::move(rows));
  }
  try {
    return make_record(raw, drive.machine.n_p, health);
  } catch (const std::runtime_error& error) {
    throw BadInput(error.what());
  }
}

void print_result(const TraceResult& r, const std::string& out) {
  fmt::print("{}\n", r.sentence);
  for (const TracedEffect& e : r.effects) {
    std::vector<std::string> parameters;
    for (const TracedParameter& p : e.parameters)
      if (!p.text.empty())
        parameters.push_back(fmt::format("{} {}", p.name, p.text));
      else
        parameters.push_back(fmt::format("{} {:.4g}{}{}", p.name, p.value,
                                         p.sigma ? fmt::format(" +- {:.2g}", *p.sigma) : "",
                                         p.unit == "1" ? "" : " " + p.unit));
    fmt::print("  {} ({}): {}\n", e.effect->kind(), e.equation, fmt::join(parameters, ", "));
    if (e.from_samples)
      fmt::print("      seen in the raw samples\n");
    else
      fmt::print("      BIC {:.0f}{}\n", e.delta_bic,
                 std::isfinite(e.held_out_gain)
                     ? fmt::format(", held-out error -{:.1f} %", 100 * e.held_out_gain)
                     : "");
  }
  for (const Ambiguity& a : r.ambiguous)
    fmt::print("  cannot tell apart: {}; {}\n", fmt::join(a.kinds, ", "), a.would_separate);
  for (const FileError& f : r.files)
    fmt::print("  {} {}: {:.4g} -> {:.4g} {} (no change: {:.4g})\n",
               f.held_out ? "unseen" : "trained", f.path, f.before, f.after, f.unit, f.no_change);
  for (const std::string& line : r.identifiable)
    if (line.find(' ') != std::string::npos) fmt::print("  {}\n", line);  // not a kind
  for (const std::string& line : r.health) fmt::print("  data: {}\n", line);
  fmt::print("{}/trace.json, extended.toml, report.html ({:.1f} s)\n", out, r.seconds);
}

// Where a share was held back, each log keeps its part of the blocks.
void hold_out(std::vector<VerifyLog>& logs, const std::vector<char>& held_out) {
  std::size_t row = 0;
  for (VerifyLog& log : logs) {
    const auto begin = held_out.begin() + static_cast<std::ptrdiff_t>(row);
    row += log.record.size();
    log.held_out.assign(begin, held_out.begin() + static_cast<std::ptrdiff_t>(row));
  }
}

// DIR/verify.json and the table.
void prove(const TraceOptions& o, const Config& declared, const std::vector<VerifyLog>& logs) {
  Config extended = Config::load(o.out + "/extended.toml");
  read_all_tables(extended);
  VerifySettings settings;
  settings.url = o.url;
  const Verification v = verify(logs, declared, extended, settings);
  write(o.out + "/verify.json", to_json(v));
  if (!o.json) fmt::print("on held-out data:\n{}{}/verify.json\n", table(v), o.out);
}

// Full drive logs, one after the other in one record. `verify_logs`: filled for --verify.
TraceResult trace_drive_logs(const TraceOptions& o, const std::vector<std::string>& held_out_files,
                             const DriveConfig& drive, const TraceSettings& settings,
                             std::vector<VerifyLog>& verify_logs) {
  std::vector<std::string> notes;
  Health health;
  Record record;
  std::vector<char> held_out;
  const auto append = [&](const std::string& path, bool unseen) {
    Health own;
    std::vector<Measurement> measurements;
    Record next = read_record(o, path, drive, own, notes, o.verify ? &measurements : nullptr);
    // Data that train are replayed only where a share of them does not.
    if (o.verify && (unseen || held_out_files.empty()))
      verify_logs.push_back({.path = path,
                             .record = next,
                             .held_out = std::vector<char>(next.size(), 1),
                             .measurements = std::move(measurements)});
    try {
      record.append(next);
    } catch (const std::runtime_error& error) {
      throw BadInput(error.what());
    }
    health.combine(own);
    held_out.resize(record.size(), unseen);
  };
  for (const std::string& path : o.data) append(path, false);
  for (const std::string& path : held_out_files) append(path, true);
  if (held_out_files.empty()) {
    held_out.clear();
    hold_out(verify_logs, held_out_rows(record, settings.holdout));
  }
  TraceResult result = trace_record(record, drive, health, settings, held_out);
  result.sources = o.data;
  result.held_out_sources = held_out_files;
  result.health.insert(result.health.end(), notes.begin(), notes.end());
  return result;
}

// What the logs of --data hold, for --plan.
std::vector<PlanLog> plan_logs(const TraceOptions& o, const DriveConfig& drive) {
  std::vector<PlanLog> logs;
  std::vector<std::string> notes;
  for (const std::string& path : o.data) {
    PlanLog log;
    log.record = read_record(o, path, drive, log.health, notes, nullptr);
    logs.push_back(std::move(log));
  }
  return logs;
}

int trace(const TraceOptions& o) {
  const Config config = load_drive(o.drive, o.overrides);
  if (o.plan.wanted)
    return plan_measurement(o.plan, config, o.out, o.json,
                            [&] { return plan_logs(o, config.drive()); });
  if (o.data.empty()) throw BadInput("trace: --data is required (without a log: --plan)");
  TraceSettings settings;
  if (o.verbose || o.json)
    settings.say = [&](const std::string& line) {
      if (o.json)
        fmt::print("{{\"progress\": \"{}\"}}\n", line);
      else
        fmt::print(stderr, "{}\n", line);
    };
  MeasuredFiles files{.data = o.data, .held_out = o.holdout, .maps = o.maps, .repair = o.repair};
  if (o.holdout.size() == 1)
    if (const auto share = fraction(o.holdout[0])) {
      files.share = settings.holdout = *share;
      files.held_out.clear();
    }
  std::vector<VerifyLog> verify_logs;
  const auto start = std::chrono::steady_clock::now();
  std::optional<TraceResult> measured = trace_measured_files(files, config.drive());
  TraceResult result =
      measured ? std::move(*measured)
               : trace_drive_logs(o, files.held_out, config.drive(), settings, verify_logs);
  if (measured)
    result.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::filesystem::create_directories(o.out);
  write(o.out + "/trace.json", to_json(result));
  const std::string extended = extended_toml(config, result, o.keep_plant);
  write(o.out + "/extended.toml", extended);
  write_trace_page(
      result, {config.drive().name, extended, config.drive().machine.n_p, twinrate::revision()},
      o.out + "/report.html");
  if (!o.json) print_result(result, o.out);
  if (o.verify && measured)
    fmt::print(stderr,
               "twinrate: --verify needs full drive logs; the error of each file is above\n");
  else if (o.verify)
    prove(o, config, verify_logs);
  return 0;
}

}  // namespace

void add_trace_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<TraceOptions>();
  auto* verb = app.add_subcommand(
      "trace",
      "Finds what a model lacks: residual, named effect, extended model, error before and after");
  verb->add_option("DRIVE", o->drive, "drive file or preset: the declared model")->required();
  verb->add_option("--data", o->data, "drive logs: CSV (may be gzipped) or LCM log")
      ->check(CLI::ExistingPath);
  verb->add_option("--holdout", o->holdout,
                   "logs that are not fitted, or the share of the data kept back (default 0.25)");
  verb->add_option("--map", o->maps,
                   "how foreign columns are read; of several each file takes the first that fits")
      ->check(CLI::ExistingFile);
  verb->add_option("--out", o->out, "directory for trace.json, extended.toml, report.html");
  verb->add_option("--set", o->overrides, "key.path=value of the drive file");
  verb->add_flag("--repair", o->repair, "leaves out a truncated last line and repeated samples");
  verb->add_flag("--keep-plant", o->keep_plant,
                 "extended.toml keeps the effects that only the simulated plant has");
  verb->add_flag("--verify", o->verify,
                 "error before and after on the held-out data: one step, free run, estimator over "
                 "LCM, closed loop; DIR/verify.json");
  verb->add_option("--lcm-url", o->url, "LCM URL for --verify");
  add_plan_options(*verb, o->plan);
  verb->add_flag("--json", o->json, "JSON lines instead of text");
  verb->add_flag("--verbose", o->verbose, "says each step of the selection");
  verb->callback([o, &exit_code] { exit_code = trace(*o); });
}

}  // namespace twinrate

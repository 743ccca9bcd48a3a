// twinrate trace: residual -> named effect -> extended model -> error before and after.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/bus.hpp"
#include "core/output_file.hpp"
#include "core/paths.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "core/result_directory.hpp"
#include "core/seconds_since.hpp"
#include "drive_log/drive_logs.hpp"
#include "drive_log/measured_files.hpp"
#include "drive_log/trace_drive_logs.hpp"
#include "loop/load_drive.hpp"
#include "report/trace_page.hpp"
#include "tools/plan_verb.hpp"
#include "tools/verb.hpp"
#include "trace/extended.hpp"
#include "trace/tracer.hpp"
#include "verify/verify.hpp"
#include "verify/verify_logs.hpp"

namespace twinrate {
namespace {

constexpr std::chrono::seconds kSilentReading{1};  // no progress line before

struct TraceOptions {
  std::string drive, out = "trace", url;
  std::vector<std::string> data, holdout, exclude, overrides, maps;
  double memory_MiB = 1024;
  bool repair = false, json = false, verbose = false, keep_plant = false, verify = false,
       force = false;
  PlanOptions plan;
};

// A share of the rows; empty if `text` is not a number.
std::optional<double> fraction(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return {};
  if (!(value > 0 && value <= 0.5))
    throw BadInput(
        fmt::format("--holdout {}: a fraction above 0 and up to 0.5, or files, allowed", text));
  return value;
}

// Throws BadInput for a kind that is not in the catalogue.
Considered considered_kinds(const std::vector<std::string>& excluded) {
  const std::vector<std::string> known = effect_kinds();
  for (const std::string& kind : excluded)
    if (std::find(known.begin(), known.end(), kind) == known.end())
      throw BadInput(fmt::format("--exclude {}: no such kind of effect; {} allowed", kind,
                                 fmt::join(known, ", ")));
  return Considered(excluded);
}

// Throws BadInput for a file given twice.
void expect_different(const std::vector<std::string>& data,
                      const std::vector<std::string>& held_out) {
  std::map<std::filesystem::path, const char*> option_of;
  for (const bool held : {false, true})
    for (const std::string& path : held ? held_out : data) {
      const char* option = held ? "--holdout" : "--data";
      std::error_code missing;  // reported by the reader
      const auto [before, first] =
          option_of.emplace(std::filesystem::weakly_canonical(path, missing), option);
      if (first || missing) continue;
      throw BadInput(
          before->second == option
              ? fmt::format("{}: is given twice in {}; give each file once", path, option)
              : fmt::format("{}: is given in --data and in --holdout; a fitted file is "
                            "no hold-out",
                            path));
    }
}

// "; from 4.3 s", "; in a.csv only": the part of the data that an effect acts in.
std::string part_of(const TracedEffect& e) {
  if (!e.only_in_part) return "";
  std::string text;
  if (e.from_s) text += fmt::format("; from {:.4g} s", *e.from_s);
  if (e.to_s) text += fmt::format("; until {:.4g} s", *e.to_s);
  if (!e.files.empty() && text.empty()) text = fmt::format("; in {}", fmt::join(e.files, ", "));
  return text;
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
    fmt::print("  {} ({}): {}{}\n", e.effect->kind(), e.equation, fmt::join(parameters, ", "),
               part_of(e));
    if (e.from_samples)
      fmt::print("      found in the raw samples\n");
    else
      fmt::print(
          "      {}{}\n",
          std::isfinite(e.delta_bic) ? fmt::format("BIC {:.0f}", e.delta_bic) : "not judged",
          std::isfinite(e.held_out_gain)
              ? fmt::format(", whitened energy of held-out rows {:+.1f} %", -100 * e.held_out_gain)
              : "");
  }
  for (const Ambiguity& a : r.ambiguous)
    fmt::print("  aliases: {}; to separate them: {}\n", fmt::join(a.kinds, ", "), a.would_separate);
  for (const Inconsistency& x : r.inconsistent)
    fmt::print("  {}{}{}: expected {}, found {}; {}\n", x.quantity, x.file.empty() ? "" : " of ",
               x.file, x.expected, x.found, x.hint);
  for (const FileError& f : r.files)
    fmt::print("  {} {}: {:.4g} -> {:.4g} {}{}\n", f.held_out ? "hold-out" : "fitted", f.path,
               f.before, f.after, f.unit,
               std::isfinite(f.no_change) ? fmt::format(" (no change: {:.4g})", f.no_change)
               : f.signals.empty()        ? ""
                                          : fmt::format(" of {}", fmt::join(f.signals, ", ")));
  for (const std::string& line : r.identifiable)
    if (line.find(' ') != std::string::npos) fmt::print("  {}\n", line);  // a sentence
  for (const std::string& line : r.health) fmt::print("  data: {}\n", line);
  fmt::print("{}/trace.json, extended.toml, report.html ({:.1f} s)\n", out, r.seconds);
}

// Writes DIR/verify.json and prints the table. Throws Stopped.
void verify_extended(const TraceOptions& o, const Config& declared,
                     const std::vector<VerifyLog>& logs) {
  Config extended = Config::load(o.out + "/extended.toml");
  read_all_tables(extended);
  VerifySettings settings;
  settings.url = o.url;
  const Verification v = verify(logs, declared, extended, settings);
  write_new(o.out + "/verify.json", to_json(v));
  if (!o.json) fmt::print("on held-out data:\n{}{}/verify.json\n", table(v), o.out);
}

// Of logs read with --repair: true if one is not whole.
bool say_damage(const DriveLogs& logs) {
  for (const std::string& line : logs.damage) fmt::print(stderr, "twinrate: {}\n", line);
  return !logs.damage.empty();
}

// Data of a trace of full drive logs besides its result.
struct Read {
  std::vector<VerifyLog> replayed;  // with --verify
  bool damaged = false;             // a log is not whole
};
TraceResult trace_full_logs(const TraceOptions& o, const LogRequest& asked,
                            const DriveConfig& drive, const TraceSettings& settings, Read& read) {
  PercentLine line(o.json ? PercentLine::Form::kJson : PercentLine::Form::kTerminal);
  const auto start = std::chrono::steady_clock::now();
  const DriveLogs logs = read_drive_logs(asked, drive, [&](const std::string& what, double share) {
    if (stop_signalled()) throw Stopped{};
    if (std::chrono::steady_clock::now() - start > kSilentReading) line.show(what, share);
  });
  line.clear();
  read.damaged = say_damage(logs);
  const std::vector<char> held_out = held_out_rows(logs, settings.holdout, drive.machine.n_p);
  TraceResult result = trace_drive_logs(logs, held_out, drive, settings);
  if (o.verify) read.replayed = verify_logs(asked, drive, logs, held_out);
  return result;
}

// The logs of --data, for --plan.
std::vector<PlanLog> plan_logs(const TraceOptions& o, const DriveConfig& drive, bool& damaged) {
  std::vector<PlanLog> logs;
  for (const std::string& path : o.data) {
    const LogRequest asked{.data = {path},
                           .held_out = {},
                           .maps = o.maps,
                           .repair = o.repair,
                           .memory_MiB = o.memory_MiB};
    DriveLogs read = read_drive_logs(asked, drive);
    damaged = say_damage(read) || damaged;
    logs.push_back({.record = std::move(read.record), .health = read.health});
  }
  return logs;
}

TraceSettings settings_of(const TraceOptions& o) {
  TraceSettings settings;
  settings.stop = stop_signalled;
  settings.fit_judging_rows = !o.verify;
  settings.considered = considered_kinds(o.exclude);
  if (o.verbose || o.json)
    settings.say = [json = o.json](const std::string& line) {
      if (json)
        fmt::print("{{\"progress\": \"{}\"}}\n", line), std::fflush(stdout);
      else
        fmt::print(stderr, "{}\n", line);
    };
  return settings;
}

// The files of --data and --holdout. Sets settings.holdout if --holdout is a share.
MeasuredFiles files_of(const TraceOptions& o, TraceSettings& settings) {
  MeasuredFiles files{.data = o.data,
                      .held_out = o.holdout,
                      .maps = o.maps,
                      .repair = o.repair,
                      .considered = settings.considered};
  if (o.holdout.size() == 1)
    if (const auto share = fraction(o.holdout[0])) {
      files.share = settings.holdout = *share;
      files.held_out.clear();
    }
  expect_different(files.data, files.held_out);
  return files;
}

// Writes DIR/trace.json, extended.toml and report.html and prints the result.
void write_result(const TraceOptions& o, const Config& config, const TraceResult& result) {
  write_new(o.out + "/trace.json", to_json(result));
  const std::string extended = extended_toml(config, result, o.keep_plant);
  write_new(o.out + "/extended.toml", extended);
  write_trace_page(
      result, {config.drive().name, extended, config.drive().machine.n_p, twinrate::revision()},
      o.out + "/report.html");
  if (o.json)
    fmt::print("{}\n",
               nlohmann::ordered_json{
                   {"verdict", result.verdict}, {"sentence", result.sentence}, {"out", o.out}}
                   .dump());
  else
    print_result(result, o.out);
  std::fflush(stdout);
}

// Exit code of --verify.
int verify_step(const TraceOptions& o, const Config& config, const std::vector<VerifyLog>& logs) {
  try {
    verify_extended(o, config, logs);
    return 0;
  } catch (const Stopped&) {
    fmt::print(stderr,
               "twinrate: interrupted during --verify; the trace in {} is complete, verify.json "
               "is not written\n",
               o.out);
    return 1;
  }
}

int trace_files(const TraceOptions& o, const Config& config) {
  ResultDirectory directory(o.out, ResultKind::kTrace, o.force);
  TraceSettings settings = settings_of(o);
  catch_stop_signals();
  const MeasuredFiles files = files_of(o, settings);
  if (o.verify) resolve_url(o.url);
  Read read;
  const auto start = std::chrono::steady_clock::now();
  std::optional<TraceResult> measured =
      trace_measured_files(files, config.drive(), {settings.say, settings.stop});
  if (measured) measured->seconds = seconds_since(start);
  const LogRequest asked{.data = files.data,
                         .held_out = files.held_out,
                         .maps = files.maps,
                         .repair = files.repair,
                         .memory_MiB = o.memory_MiB};
  const TraceResult result =
      measured ? std::move(*measured) : trace_full_logs(o, asked, config.drive(), settings, read);
  directory.begin();
  write_result(o, config, result);
  directory.finish();
  if (result.verdict == "inconsistent") return 2;
  if (result.interrupted) {
    fmt::print(stderr, "twinrate: trace interrupted; {} holds the effects found so far{}\n", o.out,
               o.verify ? ", not verified" : "");
    return 1;
  }
  if (o.verify && !measured) {
    const int code = verify_step(o, config, read.replayed);
    directory.finish();
    return read.damaged ? 1 : code;
  }
  if (o.verify)
    fmt::print(
        stderr,
        "twinrate: --verify needs full drive logs; the table above has the error of each file\n");
  return read.damaged ? 1 : 0;
}

int trace(const TraceOptions& o) {
  const Config config = load_drive(o.drive, o.overrides);
  if (o.plan.wanted) {
    bool damaged = false;
    const int code = plan_measurement(o.plan, config, {o.out, o.force, o.json},
                                      [&] { return plan_logs(o, config.drive(), damaged); });
    return damaged && code == 0 ? 1 : code;
  }
  if (o.data.empty()) throw BadInput("trace: --data is required (without a log: --plan)");
  return trace_files(o, config);
}

// Options of the input.
CLI::Option* add_input_options(CLI::App* verb, TraceOptions* o) {
  verb->add_option("DRIVE", o->drive, "use this drive file or preset as the declared model")
      ->required();
  verb->add_option("--data", o->data, "read these drive logs: CSV, gzipped CSV or LCM log")
      ->check(CLI::ExistingPath);
  CLI::Option* plan = add_plan_options(*verb, o->plan);
  verb->add_option("--holdout", o->holdout,
                   "hold these logs out of the fit, or this fraction of the rows (default 0.25)")
      ->excludes(plan);
  verb->add_option(
          "--exclude", o->exclude,
          "look for no effect of these kinds, e.g. torsion backlash; repeat or separate by "
          "commas for more")
      ->delimiter(',')
      ->excludes(plan);
  verb->add_option("--map", o->maps,
                   "read foreign columns through this map; with several, each file takes the first "
                   "that fits")
      ->check(CLI::ExistingFile);
  return plan;
}

// Options of the trace and its output.
void add_output_options(CLI::App* verb, TraceOptions* o, CLI::Option* plan) {
  verb->add_option(
      "--out", o->out,
      "write trace.json, extended.toml, report.html into this directory (default trace)");
  verb->add_option("--memory", o->memory_MiB,
                   "limit the memory, MiB (default 1024); trace longer logs on blocks spread over "
                   "their length")
      ->check(CLI::Range(64.0, 1e6));
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys");
  verb->add_flag(
      "--repair", o->repair,
      "CSV: skip a truncated last line and repeated samples; LCM: use the undamaged part of "
      "a log, exit code 1");
  verb->add_flag("--keep-plant", o->keep_plant,
                 "keep the effects of the simulated plant in extended.toml");
  verb->add_flag(
          "--verify", o->verify,
          "compare the declared and the extended model on the hold-out: one-step prediction, "
          "free run, estimator over LCM, closed loop; write verify.json")
      ->excludes(plan);
  verb->add_option("--lcm-url", o->url, "use this LCM URL for --verify");
  verb->add_flag("--force", o->force, "replace the trace (with --plan: the plan) that --out holds");
  verb->add_flag("--json", o->json, "print JSON lines instead of text");
  verb->add_flag("--verbose", o->verbose, "print each step of the selection");
}

}  // namespace

void add_trace_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<TraceOptions>();
  auto* verb = app.add_subcommand(
      "trace",
      "Find the effects that a model lacks, from a recorded drive; write the extended model");
  add_output_options(verb, o.get(), add_input_options(verb, o.get()));
  verb->callback([o, &exit_code] {
    const auto stopped = [&exit_code](const char* when) {
      fmt::print(stderr, "twinrate: trace interrupted {}, nothing written\n", when);
      exit_code = 1;
    };
    try {
      exit_code = trace(*o);
    } catch (const Stopped&) {
      stopped("while reading");
    } catch (const TraceStopped&) {
      stopped("before the first effect was found");
    }
  });
}

}  // namespace twinrate

// twinrate export LOG --format csv|mat|mcap: writes a log in a format of other tools.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "export/export_log.hpp"
#include "export/tick_table.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct ExportOptions {
  ExportRequest request;
  std::string channels;
  bool json = false, force = false, repair = false;
};

// Default path: that of the log with the suffix of the format.
std::string beside(const std::string& log, const std::string& format) {
  std::filesystem::path path(log);
  if (std::filesystem::is_directory(path)) path /= "log.lcm";
  if (path.extension() == ".gz") path.replace_extension();
  return path.replace_extension(format).string();
}

void print_export(const ExportOptions& o, const Exported& e) {
  if (o.json) {
    nlohmann::ordered_json json = {{"out", o.request.out},
                                   {"interrupted", e.interrupted},
                                   {"left_out", e.left_out},
                                   {"late", e.late},
                                   {"streams", nlohmann::json::array()}};
    for (const ExportedStream& s : e.streams)
      json["streams"].push_back(
          {{"name", s.name}, {"samples", s.samples}, {"first_s", s.first_s}, {"last_s", s.last_s}});
    fmt::print("{}\n", json.dump());
    return;
  }
  fmt::print("{}\n", o.request.out);
  for (const ExportedStream& s : e.streams)
    fmt::print("  {:<12} {:>9} samples, {:.6g} to {:.6g} s\n", s.name, s.samples, s.first_s,
               s.last_s);
  if (e.left_out > 0)
    fmt::print("  {} ticks left out: their measurement is missing or not whole\n", e.left_out);
  if (e.late > 0)
    fmt::print("  {} messages left out: they stand more than {} ticks late in the log\n", e.late,
               TickTable::kMaxLateTicks);
}

int run_export(ExportOptions o) {
  ExportRequest& r = o.request;
  if (r.format != "csv" && r.format != "mat" && r.format != "mcap")
    throw BadInput(fmt::format("--format {}: csv, mat or mcap allowed", r.format));
  if (r.compression != "zstd" && r.compression != "lz4" && r.compression != "none")
    throw BadInput(fmt::format("--compression {}: zstd, lz4 or none allowed", r.compression));
  if (!std::filesystem::exists(r.log)) throw BadInput(fmt::format("{}: no such log", r.log));
  if (r.from_s > r.to_s)
    throw BadInput(fmt::format("--from {:g} --to {:g}: from comes before to", r.from_s, r.to_s));
  if (!o.channels.empty()) r.channels = channels_of(o.channels);
  if (r.out.empty()) r.out = beside(r.log, r.format);
  std::error_code error;
  if (std::filesystem::equivalent(r.out, r.log, error))
    throw BadInput(fmt::format("{}: is the log itself; --out takes another name", r.out));
  expect_free(r.out, o.force);
  if (o.repair) r.on_damage = OnDamage::kSkip;
  catch_stop_signals();
  PercentLine line(o.json ? PercentLine::Form::kJson : PercentLine::Form::kTerminal);
  const Exported e = export_log(r, [&](double share) { line.show("exporting", share); });
  line.clear();
  if (!e.damage.empty()) fmt::print(stderr, "twinrate: {}\n", e.damage);
  print_export(o, e);
  if (!e.interrupted) return e.damage.empty() ? 0 : 1;
  fmt::print(stderr, "twinrate: export interrupted; {} holds the log up to there\n", r.out);
  return 1;
}

}  // namespace

void add_export_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<ExportOptions>();
  ExportRequest& r = o->request;
  CLI::App* verb = app.add_subcommand("export", "Write a log as a CSV, MATLAB or MCAP file");
  verb->add_option("LOG", r.log, "read this run directory, LCM log or drive log CSV")->required();
  verb->add_option("--format", r.format, "choose the format: csv, mat or mcap")->required();
  verb->add_option("--out", r.out,
                   "write this file (default: beside the log); NAME.csv.gz is gzipped");
  verb->add_option("--from", r.from_s, "begin at this time of the log, s");
  verb->add_option("--to", r.to_s, "end at this time of the log, s");
  verb->add_option(
      "--channels", o->channels,
      "select channels, separated by commas, e.g. ESTIMATE,TRUTH; csv: add their fields "
      "as columns; mat, mcap: write these instead of all");
  verb->add_option("--resample", r.rate_Hz, "resample all channels to this rate, Hz")
      ->check(CLI::Range(1e-3, 1e7));
  verb->add_option("--compression", r.compression, "pack an mcap: zstd (default), lz4 or none");
  verb->add_flag("--repair", o->repair, "export the undamaged part of a log; exit code 1");
  verb->add_flag("--force", o->force, "replace the file of --out");
  verb->add_flag("--json", o->json, "print progress and result as JSON lines");
  verb->callback([o, &exit_code] {
    try {
      exit_code = run_export(*o);
    } catch (const Stopped&) {
      fmt::print(stderr, "twinrate: export interrupted, nothing written\n");
      exit_code = 1;
    }
  });
}

}  // namespace twinrate

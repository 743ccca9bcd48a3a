// Success rate of the tracer on blind logs: single effects, pairs, triples, poor excitation, and
// logs without a missing effect. Prints a table and the confusion matrix as Markdown.
//
//   blind_trace [--sets single,double,triple,poor,none] [--first-seed K] [--seeds N] [--kinds LIST]
//               [--cache DIR] [--shard i/n] [--out FILE.json] [--verbose]
//   blind_trace --merge FILE.json ...       the tables of several shards
//   blind_trace --drawn [--set A|B|C] [--logs N] [--threads N] [--keep DIR]   drawn machines
//   blind_trace --drawn --spoilt slips|hidden [--profile P] [--mode M] [--logs N]
//
// --out stores each result at once; a log with a result in the file is skipped.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <set>

#include "bench/blind/blind_log.hpp"
#include "bench/blind/blind_report.hpp"
#include "bench/blind/drawn_trace.hpp"
#include "bench/command_line.hpp"
#include "model/random.hpp"
#include "trace/keys.hpp"
#include "trace/thinning.hpp"
#include "trace/tracer.hpp"

namespace twinrate::blind {
namespace {

struct Options {
  std::vector<std::string> sets = {"single", "double", "triple", "poor", "none"}, kinds;
  int first_seed = 1, seeds = 3;
  std::string cache, out, only;
  std::vector<std::string> merge;
  int shard = 0, shards = 1;
  bool verbose = false;
};

std::vector<Case> cases_of(const Options& o) {
  std::vector<Case> cases;
  const auto& kinds = o.kinds.empty() ? drawable_kinds() : o.kinds;
  const auto pick = [&](std::uint64_t seed, std::uint64_t stream) {
    return kinds[static_cast<std::size_t>(uniform(seed, 31, stream) * 0.999999 *
                                          static_cast<double>(kinds.size()))];
  };
  for (const std::string& set : o.sets)
    for (int s = o.first_seed; s < o.first_seed + o.seeds; ++s) {
      if (set == "single")
        for (const std::string& kind : kinds)
          cases.push_back(
              make_case("rich", {kind}, static_cast<std::uint64_t>(100 * s) + cases.size()));
      if (set == "none")
        for (const char* profile : {"rich", "slow"})
          cases.push_back(make_case(profile, {}, static_cast<std::uint64_t>(5000 + s)));
      const int members = set == "double" ? 2 : set == "triple" ? 3 : 0;
      if (members > 0)
        for (int j = 0; j < 8; ++j) {
          const auto seed = static_cast<std::uint64_t>(10000 * members + 100 * s + j);
          std::set<std::string> chosen;
          for (std::uint64_t i = 0; static_cast<int>(chosen.size()) < members; ++i)
            if (const std::string kind = pick(seed, i);
                !(kind == "backlash" && chosen.count("torsion")) &&
                !(kind == "torsion" && chosen.count("backlash")))  // one shaft per drive
              chosen.insert(kind);
          cases.push_back(make_case("rich", {chosen.begin(), chosen.end()}, seed));
        }
      if (set == "poor")
        for (const std::string& kind : kinds)
          cases.push_back(make_case(s % 2 ? "slow" : "moves", {kind},
                                    static_cast<std::uint64_t>(40000 + 100 * s) + cases.size()));
    }
  // Last, because the seeds of the other sets depend on the number of cases before them.
  if (o.kinds.empty() && std::count(o.sets.begin(), o.sets.end(), "single") > 0)
    for (int s = o.first_seed; s < o.first_seed + o.seeds; ++s)
      cases.push_back(
          make_case("rich", {"dc_bus_ripple"}, static_cast<std::uint64_t>(60000 + 100 * s)));
  return cases;
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

std::string set_of(const Case& which) {
  return which.kinds.empty()       ? "none"
         : which.profile != "rich" ? "poor"
         : which.kinds.size() == 1 ? "single"
         : which.kinds.size() == 2 ? "double"
                                   : "triple";
}

// Parameter errors of the true effects that were found, in standard deviations.
std::vector<double> errors_in_sigmas(const TraceResult& r, const Effects& truth, bool print) {
  std::vector<double> sigmas;
  for (const TracedEffect& e : r.effects)
    for (const auto& t : truth) {
      if (t->kind() != e.effect->kind()) continue;
      const auto keys = numeric_keys(*t);
      for (std::size_t i = 0; i < keys.size() && i < e.parameters.size(); ++i) {
        if (!e.parameters[i].sigma || *e.parameters[i].sigma <= 0) continue;
        double error = e.parameters[i].value - keys[i].value;
        if (keys[i].key.ends_with("phase_rad")) error = wrap_pi(error);
        sigmas.push_back(error / *e.parameters[i].sigma);
        if (print)
          fmt::print(stderr, "{} {}: {:.6g} +- {:.2g}, true {:.6g}: {:+.1f} sigma\n",
                     e.effect->kind(), keys[i].key, e.parameters[i].value, *e.parameters[i].sigma,
                     keys[i].value, sigmas.back());
      }
    }
  return sigmas;
}

// Root mean square of the held-out outputs of some channels.
double held_out_rms(const std::vector<const Eigen::VectorXd*>& channels, const Runs& runs) {
  double sum = 0, count = 0;
  for (const Eigen::VectorXd* x : channels)
    for (Eigen::Index n = 0; n < x->size(); ++n)
      if (runs.held_out[static_cast<std::size_t>(n)]) sum += (*x)[n] * (*x)[n], ++count;
  return count > 0 ? std::sqrt(sum / count) : 0;
}

// Held-out errors of the extended model over those of the model with the true effects.
void compare_with_truth(const TraceResult& r, const Record& whole, const DriveConfig& model,
                        const Effects& truth, Row& row) {
  const int n_p = model.machine.n_p;
  const std::size_t rows = rows_as_one(whole.T_s);
  const Record record = thinned(whole, rows, n_p);
  Effects all = model.model_effects();
  all.insert(all.end(), truth.begin(), truth.end());
  const Equations equations(record, model.facts(), all);
  const Sampler sampler(record, moving_rows(record),
                        thinned(held_out_rows(whole, 0.25, n_p), whole, rows));
  const Channels left = equations.residual({});
  if (r.electrical) {
    const Runs& runs = sampler.electrical();
    const Eigen::VectorXd d = sampler(left.d, runs), q = sampler(left.q, runs);
    row.electrical_ratio = r.electrical->after.held_out / held_out_rms({&d, &q}, runs);
  }
  if (r.mechanical) {
    const Eigen::VectorXd torque = sampler(left.torque, sampler.torque());
    row.mechanical_ratio = r.mechanical->after.held_out / held_out_rms({&torque}, sampler.torque());
  }
}

Row trace_case(const Case& which, const Log& log, const Options& o) {
  static const Config model = declared();
  Health health;
  const Record record = make_record(log.raw, model.drive().machine.n_p, health);
  TraceSettings settings;
  if (o.verbose) settings.say = [](const std::string& line) { fmt::print(stderr, "{}\n", line); };
  const std::clock_t begin = std::clock();
  const TraceResult r = trace_record(record, model.drive(), health, settings);
  Row row{.name = which.name, .set = set_of(which), .kinds = {}};
  for (const auto& effect : log.truth) row.kinds.emplace_back(effect->kind());
  row.seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  std::multiset<std::string> left(row.kinds.begin(), row.kinds.end());
  bool extra = false;
  for (const TracedEffect& e : r.effects) {
    std::string name(e.effect->kind());
    const auto other = std::find_if(e.aliases.begin(), e.aliases.end(),
                                    [&](const std::string& a) { return left.count(a); });
    if (const auto found = left.find(name); found != left.end())
      left.erase(found);
    else if (other != e.aliases.end() && e.aliases.size() <= 2)
      left.erase(left.find(*other));
    else
      extra = true;
    if (!e.aliases.empty()) name += fmt::format(" or {}", fmt::join(e.aliases, " or "));
    row.found.push_back(name);
  }
  for (const Structure& s : r.unexplained) row.found.push_back("unexplained: " + s.regressor);
  row.exact = left.empty() && !extra && r.unexplained.empty();
  row.sigmas = errors_in_sigmas(r, log.truth, o.verbose);
  compare_with_truth(r, record, model.drive(), log.truth, row);
  return row;
}

int run(const Options& o) {
  std::vector<Row> rows = o.out.empty() ? std::vector<Row>() : read_rows(o.out);
  const std::vector<Case> cases = cases_of(o);
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const Case& which = cases[i];
    if (static_cast<int>(i) % o.shards != o.shard) continue;
    if (which.name.find(o.only) == std::string::npos) continue;
    if (std::any_of(rows.begin(), rows.end(), [&](const Row& r) { return r.name == which.name; }))
      continue;
    try {
      rows.push_back(trace_case(which, cached_log(which, o.cache), o));
    } catch (const std::exception& error) {
      fmt::print("{}: {}\n", which.name, error.what());
      continue;
    }
    const Row& row = rows.back();
    fmt::print("{} {:<44} found {} ({:.1f} s; {:.3f} {:.3f}){}\n", row.exact ? "ok  " : "MISS",
               row.name, fmt::join(row.found, " + "), row.seconds, row.electrical_ratio,
               row.mechanical_ratio, row.exact ? "" : "   TRUE" + one_line(which.effects_toml));
    std::fflush(stdout);
    if (!o.out.empty()) write_rows(o.out, rows);
  }
  fmt::print("\n{}", tables(rows));
  return 0;
}

int merge(const std::vector<std::string>& paths) {
  std::vector<Row> rows;
  for (const std::string& path : paths)
    for (Row& row : read_rows(path)) rows.push_back(std::move(row));
  fmt::print("{}", tables(rows));
  return 0;
}

// The program twinrate beside this one in the build tree.
std::string tracer_beside() {
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe");
  return (own.parent_path().parent_path() / "tools" / "twinrate").string();
}

void add_drawn_options(bench::CommandLine& command_line, bool& on_drawn, DrawnOptions& drawn) {
  drawn.tracer = tracer_beside();
  command_line.flag("--drawn", on_drawn, "run drawn machines through the program twinrate");
  command_line.option("--set", &drawn.set, "draw this set (with --drawn)").among({"A", "B", "C"});
  command_line
      .option("--spoilt", &drawn.spoilt,
              "spoil each log by a user's slip, or by an effect outside the catalogue")
      .among({"slips", "hidden"});
  command_line.flag("--foreign", drawn.foreign,
                    "draw logs of a plant that shares no code with the project's (with --drawn)");
  command_line.option("--profile", &drawn.profile, "draw logs of this profile only (with --drawn)");
  command_line.option("--kind", &drawn.kind,
                      "draw logs with an effect of this kind only (with --drawn)");
  command_line.option("--mode", &drawn.mode, "draw logs of this mode only (with --drawn)");
  command_line.option("--logs", &drawn.logs, "draw this many logs (with --drawn)");
  command_line.option("--threads", &drawn.threads, "trace this many logs at once (with --drawn)");
  command_line.option("--keep", &drawn.keep,
                      "keep drive files, logs and truths in this directory (with --drawn)");
  command_line.flag("--traced", drawn.traced, "take the traces that --keep holds (with --drawn)");
  command_line.option("--tracer", &drawn.tracer, "run this program (with --drawn)").existing_file();
}

}  // namespace
}  // namespace twinrate::blind

// An exception of CLI11 outside parsing is a mistake in the options above.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  using namespace twinrate::blind;
  Options o;
  twinrate::bench::CommandLine command_line{
      "Count how often the tracer names the missing effect, on logs of the project's own plant"};
  std::string shard;
  command_line.option("--sets", &o.sets, "run these sets: single, double, triple, poor, none")
      .by_comma();
  std::vector<std::string> kinds = drawable_kinds();
  kinds.emplace_back("dc_bus_ripple");
  command_line.option("--kinds", &o.kinds, "draw these kinds only").by_comma().among(kinds);
  command_line.option("--first-seed", &o.first_seed, "begin at this seed");
  command_line.option("--seeds", &o.seeds, "draw this many logs of each kind");
  command_line.option("--merge", &o.merge, "print the tables of these --out files only");
  command_line.option("--cache", &o.cache, "keep the simulated logs in this directory");
  command_line.option("--only", &o.only, "run the cases with this text in their name only");
  command_line.option("--shard", &shard, "run part i of n, i/n");
  command_line.option("--out", &o.out, "write every case to this JSON file");
  command_line.flag("--verbose", o.verbose, "print each step of the selection");
  bool on_drawn = false;
  DrawnOptions drawn;
  add_drawn_options(command_line, on_drawn, drawn);
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (on_drawn) {
    drawn.first_seed = static_cast<std::uint64_t>(o.first_seed);
    drawn.only = o.only, drawn.out = o.out;
    try {
      return run_drawn(drawn);
    } catch (const twinrate::BadInput& error) {
      fmt::print(stderr, "blind_trace: {}\n", error.what());
      return 2;
    }
  }
  if (!shard.empty() && std::sscanf(shard.c_str(), "%d/%d", &o.shard, &o.shards) != 2) return 2;
  return o.merge.empty() ? run(o) : merge(o.merge);
}

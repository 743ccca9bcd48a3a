// How often the tracer names what is missing: single effects, pairs, triples, poor excitation, and
// logs with nothing missing. Prints a table and the confusion matrix as Markdown.
//
//   blind_trace [--sets single,double,triple,poor,none] [--seeds N] [--kinds LIST] [--cache DIR]
//               [--shard i/n] [--out FILE.json] [--verbose]
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "bench/blind/blind_log.hpp"
#include "model/random.hpp"
#include "trace/keys.hpp"
#include "trace/tracer.hpp"

namespace twinrate::blind {
namespace {

using json = nlohmann::ordered_json;

struct Options {
  std::vector<std::string> sets = {"single", "double", "triple", "poor", "none"}, kinds;
  int seeds = 3;
  std::string cache, out, only;
  int shard = 0, shards = 1;
  bool verbose = false;
};

std::vector<std::vector<double>*> columns_of(RawLog& raw) {
  return {&raw.t,      &raw.i_a,     &raw.i_b,  &raw.i_c,   &raw.u_alpha,
          &raw.u_beta, &raw.theta_m, &raw.v_dc, &raw.T_load};
}

Log cached_log(const Case& which, const std::string& cache) {
  if (cache.empty()) return make_log(which);
  const std::string path = cache + "/" + which.name + ".bin";
  if (std::ifstream file(path, std::ios::binary); file) {
    Log log;
    log.raw.path = which.name;
    const Config config = Config::parse(
        Config::load("niewiara2020").resolved_with({}) + which.effects_toml, which.name);
    log.truth = config.drive().plant_effects();
    std::uint64_t n = 0;
    file.read(reinterpret_cast<char*>(&n), sizeof n);
    for (std::vector<double>* c : columns_of(log.raw)) {
      c->resize(n);
      file.read(reinterpret_cast<char*>(c->data()),
                static_cast<std::streamsize>(n * sizeof(double)));
    }
    return log;
  }
  Log log = make_log(which);
  std::filesystem::create_directories(cache);
  std::ofstream file(path, std::ios::binary);
  const std::uint64_t n = log.raw.t.size();
  file.write(reinterpret_cast<const char*>(&n), sizeof n);
  for (std::vector<double>* c : columns_of(log.raw))
    file.write(reinterpret_cast<const char*>(c->data()),
               static_cast<std::streamsize>(n * sizeof(double)));
  return log;
}

std::vector<Case> cases_of(const Options& o) {
  std::vector<Case> cases;
  const auto& kinds = o.kinds.empty() ? drawable_kinds() : o.kinds;
  const auto pick = [&](std::uint64_t seed, std::uint64_t stream) {
    return kinds[static_cast<std::size_t>(uniform(seed, 31, stream) * 0.999999 *
                                          static_cast<double>(kinds.size()))];
  };
  for (const std::string& set : o.sets)
    for (int s = 1; s <= o.seeds; ++s) {
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
            chosen.insert(pick(seed, i));
          cases.push_back(make_case("rich", {chosen.begin(), chosen.end()}, seed));
        }
      if (set == "poor")
        for (const std::string& kind : kinds)
          cases.push_back(make_case(s % 2 ? "slow" : "moves", {kind},
                                    static_cast<std::uint64_t>(40000 + 100 * s) + cases.size()));
    }
  return cases;
}

struct Verdict {
  bool exact = false, in_alias = false;
  std::vector<std::string> found;
  double worst_sigmas = 0;
  std::vector<double> sigmas;
  double seconds = 0, held_out_ratio = 0;
};

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

// Parameter errors of the effects that were found, in sigmas.
void compare(const TraceResult& r, const Effects& truth, Verdict& v) {
  for (const TracedEffect& e : r.effects)
    for (const auto& t : truth) {
      if (t->kind() != e.effect->kind()) continue;
      const auto keys = numeric_keys(*t);
      for (std::size_t i = 0; i < keys.size() && i < e.parameters.size(); ++i) {
        if (!e.parameters[i].sigma || *e.parameters[i].sigma <= 0) continue;
        double error = e.parameters[i].value - keys[i].value;
        if (keys[i].key.ends_with("phase_rad")) error = wrap_pi(error);
        v.sigmas.push_back(error / *e.parameters[i].sigma);
      }
    }
}

Verdict judge(const Case& which, const Log& log, const Options& o) {
  static const Config model = declared();
  Health health;
  const Record record = make_record(log.raw, model.drive().machine.n_p, health);
  TraceSettings settings;
  if (o.verbose) settings.say = [](const std::string& line) { fmt::print(stderr, "{}\n", line); };
  const TraceResult r = trace_record(record, model.drive(), health, settings);
  Verdict v;
  v.seconds = r.seconds;
  std::multiset<std::string> left(which.kinds.begin(), which.kinds.end());
  bool extra = false, alias = false;
  for (const TracedEffect& e : r.effects) {
    std::string name(e.effect->kind());
    if (const auto found = left.find(name); found != left.end()) {
      left.erase(found);
    } else {
      const auto other = std::find_if(e.aliases.begin(), e.aliases.end(),
                                      [&](const std::string& a) { return left.count(a); });
      if (other != e.aliases.end() && e.aliases.size() <= 2) {
        left.erase(left.find(*other));
        alias = true;
      } else {
        extra = true;
      }
    }
    if (!e.aliases.empty()) name += fmt::format("|{}", fmt::join(e.aliases, "|"));
    v.found.push_back(name);
  }
  for (const Structure& s : r.unexplained) v.found.push_back("unexplained:" + s.regressor);
  v.exact = left.empty() && !extra && r.unexplained.empty();
  v.in_alias = v.exact && alias;
  compare(r, log.truth, v);
  return v;
}

int run(const Options& o) {
  const std::vector<Case> cases = cases_of(o);
  std::map<std::string, std::pair<int, int>> by_set;
  std::map<std::string, std::map<std::string, int>> confusion;
  std::vector<double> sigmas;
  json rows = json::array();
  for (std::size_t i = 0; i < cases.size(); ++i) {
    if (static_cast<int>(i) % o.shards != o.shard) continue;
    if (cases[i].name.find(o.only) == std::string::npos) continue;
    const Case& which = cases[i];
    Verdict v;
    try {
      const Log log = cached_log(which, o.cache);
      v = judge(which, log, o);
    } catch (const std::exception& error) {
      fmt::print("{}: {}\n", which.name, error.what());
      continue;
    }
    const std::string set = which.kinds.empty()       ? "none"
                            : which.profile != "rich" ? "poor"
                            : which.kinds.size() == 1 ? "single"
                            : which.kinds.size() == 2 ? "double"
                                                      : "triple";
    auto& [right, all] = by_set[set];
    right += v.exact;
    ++all;
    sigmas.insert(sigmas.end(), v.sigmas.begin(), v.sigmas.end());
    if (which.kinds.size() <= 1)
      ++confusion[which.kinds.empty() ? "none" : which.kinds[0]]
                 [v.found.empty() ? "none" : fmt::format("{}", fmt::join(v.found, "+"))];
    fmt::print("{} {:<44} found {} ({:.1f} s){}\n", v.exact ? "ok  " : "MISS", which.name,
               fmt::join(v.found, " + "), v.seconds,
               v.exact ? "" : "   TRUE" + one_line(which.effects_toml));
    std::fflush(stdout);
    rows.push_back({{"name", which.name},
                    {"set", set},
                    {"exact", v.exact},
                    {"found", v.found},
                    {"sigmas", v.sigmas},
                    {"seconds", v.seconds}});
  }
  fmt::print("\n| set | logs | exact | share |\n|---|---|---|---|\n");
  for (const auto& [set, counts] : by_set)
    fmt::print("| {} | {} | {} | {:.1f} % |\n", set, counts.second, counts.first,
               100.0 * counts.first / counts.second);
  const auto within = [&](double n) {
    return 100.0 *
           static_cast<double>(std::count_if(sigmas.begin(), sigmas.end(),
                                             [&](double s) { return std::abs(s) < n; })) /
           std::max<double>(1, static_cast<double>(sigmas.size()));
  };
  fmt::print("\n{} parameters: {:.1f} % within 1 sigma, {:.1f} % within 3 sigma\n", sigmas.size(),
             within(1), within(3));
  fmt::print("\n| missing | found |\n|---|---|\n");
  for (const auto& [kind, found] : confusion) {
    std::vector<std::string> cells;
    for (const auto& [name, count] : found) cells.push_back(fmt::format("{} {}", count, name));
    fmt::print("| {} | {} |\n", kind, fmt::join(cells, ", "));
  }
  if (!o.out.empty()) std::ofstream(o.out) << json{{"cases", rows}}.dump(1) << "\n";
  return 0;
}

}  // namespace
}  // namespace twinrate::blind

int main(int argc, char** argv) {
  using namespace twinrate::blind;
  Options o;
  CLI::App app{"How often the tracer names what is missing, on logs of the project's own plant"};
  std::string shard;
  app.add_option("--sets", o.sets, "of single, double, triple, poor, none")->delimiter(',');
  app.add_option("--kinds", o.kinds, "only these kinds")->delimiter(',');
  app.add_option("--seeds", o.seeds, "logs of each sort");
  app.add_option("--cache", o.cache, "directory that keeps the simulated logs");
  app.add_option("--only", o.only, "only cases whose name holds this");
  app.add_option("--shard", shard, "i/n");
  app.add_option("--out", o.out, "JSON of every case");
  app.add_flag("--verbose", o.verbose, "each step of the selection");
  CLI11_PARSE(app, argc, argv);
  if (!shard.empty() && std::sscanf(shard.c_str(), "%d/%d", &o.shard, &o.shards) != 2) return 2;
  return run(o);
}

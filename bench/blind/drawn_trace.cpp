#include "bench/blind/drawn_trace.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <optional>
#include <thread>

#include "bench/blind/drawn_report.hpp"
#include "bench/blind/drawn_slips.hpp"
#include "bench/blind/drawn_visible.hpp"
#include "bench/blind/foreign_log.hpp"
#include "core/config.hpp"

namespace twinrate::blind {
namespace {

using json = nlohmann::ordered_json;
namespace fs = std::filesystem;

// The seeds of the sets. Neither thresholds nor ranges of the draws were chosen on C.
DrawnOptions with_set(DrawnOptions o) {
  if (o.set.empty()) return o;
  const int index = o.set[0] - 'A';
  o.first_seed = 1000000 * static_cast<std::uint64_t>(index + 1) + 1;
  if (o.logs == 0) o.logs = o.set == "C" ? 1000 : 300;
  return o;
}

void write(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (!file.flush()) throw BadInput(path + ": cannot be written");
}

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

json truth_of(const DrawnCase& c, const DrawnLog& log) {
  return {{"name", c.name},
          {"seed", c.seed},
          {"attempt", c.attempt},
          {"profile", c.profile},
          {"mode", c.mode},
          {"voltage", c.mean_voltage ? "mean up to the next row" : "of the tick"},
          {"rate_Hz", c.drawn.f_s / c.every},
          {"f_s_Hz", c.drawn.f_s},
          {"encoder_counts", c.drawn.encoder_counts},
          {"angle_noise_rad", c.drawn.encoder_counts ? 0 : c.drawn.angle_noise},
          {"counts_declared", c.drawn.counts_declared},
          {"current_sensors", c.drawn.current_sensors},
          {"largest_current_A", log.largest_current},
          {"largest_speed_rad_s", log.largest_speed},
          {"kinds", log.truth},
          {"effects_toml", c.effects_toml}};
}

// A log to be drawn: its seed, and its slip or hidden effect.
struct Drawn {
  std::uint64_t seed;
  int spoilt = -1;  // number of the slip or of the hidden effect
};

// True if the case has the profile, mode and kind of the options and, for a spoilt log, no effect.
bool is_asked_for(const DrawnOptions& o, const DrawnCase& c) {
  return (o.profile.empty() || c.profile == o.profile) && (o.mode.empty() || c.mode == o.mode) &&
         (o.kind.empty() || std::count(c.kinds.begin(), c.kinds.end(), o.kind) > 0) &&
         (o.spoilt.empty() || c.kinds.empty());
}

// Draws a case, and another one if the loop loses the drive.
std::pair<DrawnCase, DrawnLog> held_case(const DrawnOptions& o, const Drawn& drawn) {
  for (int attempt = 0;; ++attempt) {
    DrawnCase c = draw_case(drawn.seed, attempt);
    if (!is_asked_for(o, c)) continue;
    if (o.spoilt == "hidden") {
      Draw d(drawn.seed + 77);
      c.hidden = draw_hidden(drawn.spoilt, d, c.drawn);
    }
    if (!o.spoilt.empty()) c.name += fmt::format("-{}", drawn.spoilt);
    DrawnLog log = make_log(c);
    if (!log.ran_away || attempt == 50) return {std::move(c), std::move(log)};
  }
}

// The machine of the drive file, and the kinds that are right to name.
struct Declared {
  DrawnMachine machine;
  std::string spoilt;  // slip or hidden effect, in words; "": none in this log
  std::vector<std::string> same;
};

Declared declare(const DrawnOptions& o, const Drawn& drawn, const DrawnCase& c, DrawnLog& log) {
  Declared declared{.machine = c.drawn, .spoilt = c.hidden.name, .same = c.hidden.parts};
  if (o.spoilt != "slips") return declared;
  const Slip& slip = slips()[static_cast<std::size_t>(drawn.spoilt)];
  const bool made = slip.make(declared.machine, log);
  declared.spoilt = made ? slip.name : "";
  declared.same = slip.same;
  return declared;
}

struct Ran {
  int status;
  double cpu_s;
};
Ran run(const std::string& command) {
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    _exit(127);
  }
  int status = -1;
  rusage used{};
  if (child < 0 || wait4(child, &status, 0, &used) != child) return {-1, 0};
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {status, seconds(used.ru_utime) + seconds(used.ru_stime)};
}

// Writes the files of a log and traces them; the trace goes into BASE.trace.
void trace_files(const DrawnOptions& o, const std::string& base, const DrawnCase& c,
                 const DrawnMachine& declared, const DrawnLog& log, const json& truth) {
  const int counts = c.drawn.counts_declared ? c.drawn.encoder_counts : 0;
  write(base + ".toml", drive_toml(declared, c.name, counts));
  if (!o.foreign) write(base + ".plant.toml", plant_toml(c));
  write(base + ".truth.json", truth.dump(1) + "\n");
  if (o.traced && fs::exists(base + ".trace/trace.json")) return;
  write_csv(log, base + ".csv.gz");
  fs::remove_all(base + ".trace");
  const std::string command =
      fmt::format("'{}' trace '{}.toml' --data '{}.csv.gz' --out '{}.trace' > '{}.txt' 2>&1",
                  o.tracer, base, base, base, base);
  const auto [status, cpu_s] = run(command);
  const bool inconsistent = WIFEXITED(status) && WEXITSTATUS(status) == 2;  // has a result, too
  if (status != 0 && !inconsistent) fs::remove(base + ".trace/trace.json");
  write(base + ".cpu_s", fmt::format("{:.3f}\n", cpu_s));
  fs::remove(base + ".trace/report.html");
}

nlohmann::json result_of(const std::string& base) {
  if (std::ifstream file(base + ".trace/trace.json"); file) return nlohmann::json::parse(file);
  return {{"verdict", "error"},
          {"sentence", first_line(base + ".txt")},
          {"effects", json::array()},
          {"unexplained", {{"where", json::array()}}}};
}

std::optional<DrawnRow> trace_one(const DrawnOptions& o, const std::string& directory,
                                  const Drawn& drawn) {
  auto [c, log] = o.foreign ? draw_foreign(drawn.seed) : held_case(o, drawn);
  const Declared declared = declare(o, drawn, c, log);
  if (o.spoilt == "slips" && declared.spoilt.empty()) return std::nullopt;  // not in this log
  const Deviations deviations = o.foreign ? Deviations() : deviations_in_log(c, log.truth);
  const std::vector<std::string> visible =
      o.foreign ? log.truth : visible_kinds(deviations, log.truth);
  const std::string base = directory + "/" + c.name;
  json truth = truth_of(c, log);
  truth["visible"] = visible, truth["deviations"] = deviations;
  truth["spoilt"] = declared.spoilt;
  trace_files(o, base, c, declared.machine, log, truth);
  DrawnRow row = compare(c, log.truth, visible, result_of(base));
  row.deviations = deviations;
  row.spoilt = declared.spoilt;
  std::erase_if(row.wrong, [&](const std::string& kind) {
    return std::count(declared.same.begin(), declared.same.end(), kind) > 0;
  });
  if (const std::string cpu_s = first_line(base + ".cpu_s"); !cpu_s.empty())
    row.seconds = std::stod(cpu_s);
  if (row.verdict == "error") row.exact = row.right = false;
  if (o.keep.empty())
    for (const auto& file : fs::directory_iterator(directory))
      if (file.path().filename().string().starts_with(c.name + ".")) fs::remove_all(file.path());
  return row;
}

void print(const DrawnRow& r) {
  if (!r.spoilt.empty()) {
    fmt::print("{:<5} {} {} {} {:.0f} Hz {} | {} | {} | found: {}\n      {}\n",
               r.false_claim()   ? "FALSE"
               : r.wrong.empty() ? "ok"
                                 : "wrong",
               r.name, r.profile, r.mode, r.rate_Hz, r.encoder, r.spoilt, r.verdict,
               fmt::join(r.found, " + "), r.sentence);
    return;
  }
  const char* mark = r.false_claim() ? "FALSE" : !r.wrong.empty() ? "wrong" : r.right ? "ok" : "-";
  fmt::print("{:<5} {} {} {} {:.0f} Hz {} | {} | true: {} | shows: {} | found: {}{}\n", mark,
             r.name, r.profile, r.mode, r.rate_Hz, r.encoder, r.verdict, fmt::join(r.truth, " + "),
             fmt::join(r.visible, " + "), fmt::join(r.found, " + "),
             r.flawed_sentence ? " | FALLS UPWARDS" : "");
}

std::vector<Drawn> draws_of(const DrawnOptions& o) {
  std::vector<Drawn> draws;
  const int kinds = o.spoilt == "slips"    ? static_cast<int>(slips().size())
                    : o.spoilt == "hidden" ? hidden_count()
                                           : 1;
  for (int j = 0; j < o.logs; ++j) {
    const auto step = static_cast<std::uint64_t>(o.spoilt == "slips" ? j / kinds : j);
    Drawn drawn{.seed = o.first_seed + step};
    if (!o.spoilt.empty()) drawn = {2 * (o.first_seed + step), j % kinds};  // even: no effect
    const bool of_set = o.spoilt.empty();
    const std::string name = fmt::format("{}{}", o.foreign ? "foreign" : "drawn", drawn.seed) +
                             (of_set ? "" : fmt::format("-{}", drawn.spoilt));
    const bool any = o.profile.empty() && o.mode.empty() && o.kind.empty();
    if (name.find(o.only) == std::string::npos) continue;
    if (!of_set || any || is_asked_for(o, draw_case(drawn.seed))) draws.push_back(drawn);
  }
  return draws;
}

// Rows in the order of the draws.
std::vector<DrawnRow> trace_all(const DrawnOptions& o, const std::string& directory) {
  const std::vector<Drawn> draws = draws_of(o);
  std::vector<std::optional<DrawnRow>> rows(draws.size());
  std::atomic<std::size_t> next = 0;
  std::mutex printing;
  const auto work = [&] {
    for (std::size_t j = next++; j < draws.size(); j = next++) {
      try {
        rows[j] = trace_one(o, directory, draws[j]);
      } catch (const std::exception& error) {
        DrawnRow& row = rows[j].emplace();
        row.name = fmt::format("drawn{}", draws[j].seed);
        row.spoilt = o.spoilt;
        row.verdict = "error", row.sentence = error.what();
      }
      if (!rows[j]) continue;
      const std::lock_guard lock(printing);
      print(*rows[j]);
      std::fflush(stdout);
    }
  };
  std::vector<std::jthread> threads;
  for (int j = 1; j < o.threads; ++j) threads.emplace_back(work);
  work();
  threads.clear();
  std::vector<DrawnRow> traced;
  for (auto& row : rows)
    if (row) traced.push_back(std::move(*row));
  return traced;
}

}  // namespace

int run_drawn(const DrawnOptions& asked) {
  if (asked.foreign &&
      !(asked.spoilt + asked.set + asked.profile + asked.mode + asked.kind).empty())
    throw BadInput("--foreign goes with --first-seed and --logs alone");
  const DrawnOptions o = with_set(asked);
  const bool keep = !o.keep.empty();
  const std::string directory =
      keep ? o.keep
           : fs::temp_directory_path().string() + fmt::format("/twinrate-drawn-{}", getpid());
  fs::create_directories(directory);
  const std::vector<DrawnRow> rows = trace_all(o, directory);
  if (!keep) fs::remove_all(directory);
  const std::string text = tables(rows);
  fmt::print("\n{}", text);
  if (o.out.empty()) return 0;
  json list = json::array();
  for (const DrawnRow& row : rows) list.push_back(to_json(row));
  write(o.out, json{{"set", o.set}, {"first_seed", o.first_seed}, {"logs", list}}.dump(1) + "\n");
  return 0;
}

}  // namespace twinrate::blind

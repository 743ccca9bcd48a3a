// Damaged logs against the programs of the user, under a memory limit, as the table of docs/faults.md.
//
//   damaged_programs --set TWINRATE [--logs 300] [--seed 1]
//
// The logs are those of `TWINRATE simulate` for 0.4 s, damaged at a random place in one of the ways
// of tests/support/damaged_log.hpp. Each program reads each log, and once the undamaged one. It may
// use kAddressSpace bytes of address space and kSeconds. A row for each program:
//
//   refused    exit code 2; the line names the log, event number and byte; nothing is written
//   repaired   with --repair: exit code 1 with such a line
//   nothing    with --repair: exit code 2, because what is whole is too little for the program
//   wrong      anything else: the log is taken for whole, a signal, no end, another line, "bit for
//              bit", a file after a refusal
//   memory     the largest resident memory of the reader, beside that for the undamaged log
//
// Exit code 1 if anything is wrong. Needs a network of its own: `unshare -n`.
#include <fmt/format.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "bench/child.hpp"
#include "bench/command_line.hpp"
#include "core/event_log.hpp"
#include "core/report_error.hpp"
#include "tests/support/damaged_log.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

constexpr rlim_t kAddressSpace = rlim_t{1} << 30;
constexpr unsigned kSeconds = 60;

struct Row {
  const char* name;
  std::vector<std::string> words;  // {log}, {out}, {url}
};
const std::vector<Row> kRows = {
    {"export, csv", {"export", "{log}", "--format", "csv", "--out", "{out}.csv"}},
    {"export, csv, resampled",
     {"export", "{log}", "--format", "csv", "--resample", "1000", "--out", "{out}.csv"}},
    {"export, mat", {"export", "{log}", "--format", "mat", "--out", "{out}.mat"}},
    {"export, mcap", {"export", "{log}", "--format", "mcap", "--out", "{out}.mcap"}},
    {"report", {"report", "{log}", "--out", "{out}.html"}},
    {"trace, memory 64 MiB",
     {"trace", "dilys2021", "--data", "{log}", "--memory", "64", "--out", "{out}"}},
    {"replay, lock-step", {"replay", "{log}", "--lockstep", "--lcm-url", "{url}"}},
    {"replay, by time", {"replay", "{log}", "--speed", "1000", "--lcm-url", "{url}"}},
};
const Row kSweep = {"sweep fb --log",
                    {"sweep", "fb", "dilys2021", "--log", "{log}", "--out", "{out}"}};

std::string text_of(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

struct End {
  int exit_code = -1;  // -1: a signal
  double memory_MB = 0;
  std::string out, err;
};

class Bench {
 public:
  Bench(std::string twinrate, fs::path scratch)
      : twinrate_(std::move(twinrate)), scratch_(std::move(scratch)) {}

  End run(const Row& row, bool repair) const {
    std::vector<std::string> words = {twinrate_};
    for (std::string word : row.words) {
      for (const auto& [name, path] : {std::pair{"{log}", log()}, {"{out}", result()}})
        if (const auto at = word.find(name); at != std::string::npos)
          word.replace(at, 5, path.string());
      words.push_back(word == "{url}" ? url_of_this_process() : word);
    }
    if (repair) words.emplace_back("--repair");
    return end_of(words);
  }
  fs::path log() const { return scratch_ / "log.lcm"; }
  bool wrote() const {
    for (const auto& entry : fs::directory_iterator(scratch_))
      if (entry.path().filename().string().starts_with("result")) return true;
    return false;
  }
  void clear() const {
    for (const char* end : {"", ".csv", ".mat", ".mcap", ".html", ".toml"})
      fs::remove_all(result().string() + end);
  }
  End end_of(const std::vector<std::string>& words) const {
    const fs::path out = scratch_ / "out", err = scratch_ / "err";
    const rlimit space{.rlim_cur = kAddressSpace, .rlim_max = RLIM_INFINITY};
    rlimit before{};
    getrlimit(RLIMIT_AS, &before);
    setrlimit(RLIMIT_AS, &space);
    const pid_t pid = start(words, out, err);
    setrlimit(RLIMIT_AS, &before);
    const End end = wait_for(pid);
    return {end.exit_code, end.memory_MB, text_of(out), text_of(err)};
  }

 private:
  fs::path result() const { return scratch_ / "result"; }
  static End wait_for(pid_t pid) {
    End end;
    int status = 0;
    rusage used{};
    for (unsigned ms = 0; wait4(pid, &status, WNOHANG, &used) == 0; ms += 2) {
      if (ms == 1000 * kSeconds) kill(pid, SIGKILL);
      usleep(2000);
    }
    if (WIFEXITED(status)) end.exit_code = WEXITSTATUS(status);
    end.memory_MB = static_cast<double>(used.ru_maxrss) / 1024;
    return end;
  }

  std::string twinrate_;
  fs::path scratch_;
};

// The first line of an error: "twinrate: LOG: event N, byte M: ..".
bool names_the_place(const std::string& err, const std::string& log) {
  const auto at = err.find("twinrate: " + log + ": ");
  return at != std::string::npos && err.find("event ", at) < err.find(", byte ", at) &&
         err.find(", byte ", at) != std::string::npos;
}

bool is_one_line(const std::string& text) {
  return !text.empty() && text.find('\n') == text.size() - 1;
}

struct Counts {
  int refused = 0, repaired = 0, nothing = 0, wrong = 0;
  double memory_MB = 0, undamaged_MB = 0;
};

void judge(const Bench& bench, const Row& row, bool repair, std::uint64_t seed, Counts& counts) {
  const End end = bench.run(row, repair);
  counts.memory_MB = std::max(counts.memory_MB, end.memory_MB);
  const bool place = names_the_place(end.err, bench.log().string());
  const bool equal = end.out.find("bit for bit") != std::string::npos;
  const bool refused = end.exit_code == 2 && !bench.wrote() && is_one_line(end.err);
  if (!repair && refused && place)
    ++counts.refused;
  else if (repair && end.exit_code == 1 && place && !equal)
    ++counts.repaired;
  else if (repair && refused)
    ++counts.nothing;
  else {
    ++counts.wrong;
    fmt::print(stderr, "{}{}: seed {}, kind {}: exit code {}\n{}\n", row.name,
               repair ? " --repair" : "", seed, seed % test::Damage::kKinds, end.exit_code,
               end.err);
  }
  bench.clear();
}

// The events of a log of this project.
std::vector<test::RawEvent> events_of(const std::string& path) {
  EventLog log(path, OnDamage::kRefuse);
  std::vector<test::RawEvent> events;
  while (const lcm::LogEvent* event = log.next()) {
    const auto* bytes = static_cast<const std::uint8_t*>(event->data);
    events.push_back({.number = event->eventnum,
                      .timestamp = event->timestamp,
                      .channel = event->channel,
                      .bytes = {bytes, bytes + event->datalen},
                      .channel_length = static_cast<std::int32_t>(event->channel.size()),
                      .data_length = event->datalen});
  }
  return events;
}

int table(const Bench& bench, const std::string& recorded, int logs, std::uint64_t seed) {
  const std::vector<test::RawEvent> whole = events_of(recorded);
  std::vector<std::pair<const Row*, bool>> rows;
  for (const Row& row : kRows)
    for (const bool repair : {false, true}) rows.emplace_back(&row, repair);
  rows.emplace_back(&kSweep, false);
  std::vector<Counts> counts(rows.size());
  bool well = true;
  fs::copy_file(recorded, bench.log());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const End end = bench.run(*rows[i].first, false);
    counts[i].undamaged_MB = end.memory_MB;
    if (end.exit_code != 0) {
      well = false;
      fmt::print(stderr, "{}: exit code {} with the undamaged log\n{}\n", rows[i].first->name,
                 end.exit_code, end.err);
    }
    bench.clear();
  }
  for (std::uint64_t s = seed; s < seed + static_cast<std::uint64_t>(logs); ++s) {
    std::ofstream(bench.log(), std::ios::binary)
        << test::Damage(whole, s).apply(static_cast<int>(s % test::Damage::kKinds));
    for (std::size_t i = 0; i < rows.size(); ++i)
      judge(bench, *rows[i].first, rows[i].second, s, counts[i]);
  }
  fmt::print(
      "| program | logs | refused | repaired | nothing | wrong | memory, undamaged |\n"
      "|---|---|---|---|---|---|---|\n");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Counts& c = counts[i];
    fmt::print("| {}{} | {} | {} | {} | {} | {} | {:.0f}, {:.0f} MB |\n", rows[i].first->name,
               rows[i].second ? ", --repair" : "", logs, c.refused, c.repaired, c.nothing, c.wrong,
               c.memory_MB, c.undamaged_MB);
    well = well && c.wrong == 0;
  }
  return well ? 0 : 1;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("Damaged logs against the programs of the user, as a table");
  std::string twinrate;
  int logs = 300, seed = 1;
  command_line.option("--set", &twinrate, "run this twinrate");
  command_line.option("--logs", &logs, "damage this many logs");
  command_line.option("--seed", &seed, "begin with this seed");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  char name[] = "/tmp/damaged-programs-XXXXXX";
  if (!mkdtemp(name)) throw BadInput("no directory can be made in /tmp");
  const fs::path scratch = name;
  const Bench bench(twinrate, scratch);
  const End recorded = bench.end_of({twinrate, "simulate", "dilys2021", "--duration", "0.4s",
                                     "--run-dir", (scratch / "run").string()});
  if (!fs::exists(scratch / "run" / "log.lcm")) throw BadInput("no log: " + recorded.err);
  const int code =
      table(bench, (scratch / "run" / "log.lcm").string(), logs, static_cast<std::uint64_t>(seed));
  std::error_code ignored;
  fs::remove_all(scratch, ignored);
  return code;
} catch (...) {
  return twinrate::report_error("damaged_programs");
}

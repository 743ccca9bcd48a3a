// Damaged logs against the programs that read logs, under a memory limit.
//
//   damaged_logs TWINRATE [COUNT] [SEED]     default: 10000 logs from seed 1
//
// Every log is read in this process's children (200 logs each); every hundredth also by `TWINRATE
// export`, `report` and `trace`. Prints how many were refused, taken for whole, and ended a reader,
// and exits with 1 if there is any of the last two.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "core/report_error.hpp"
#include "core/run_log.hpp"
#include "tests/support/damaged_log.hpp"

namespace {

using namespace twinrate;
namespace fs = std::filesystem;

constexpr std::uint64_t kAtOnce = 200, kEveryProgram = 100;
constexpr rlim_t kMemory = 400 << 20;

struct Outcome {
  long refused = 0, taken = 0, ended = 0;
};

void limit() {
  const rlimit memory{.rlim_cur = kMemory, .rlim_max = kMemory};
  setrlimit(RLIMIT_DATA, &memory);
  alarm(120);
}

void write_log(const fs::path& path, const std::vector<test::RawEvent>& whole, std::uint64_t seed) {
  const int kind = static_cast<int>(seed % test::Damage::kKinds);
  std::ofstream(path, std::ios::binary) << test::Damage(whole, seed).apply(kind);
}

int taken_of(const fs::path& log, const std::vector<test::RawEvent>& whole, std::uint64_t first,
             std::uint64_t end) {
  int taken = 0;
  for (std::uint64_t seed = first; seed < end; ++seed) {
    write_log(log, whole, seed);
    for (const OnDamage on_damage : {OnDamage::kRefuse, OnDamage::kSkip}) {
      try {
        const RunLog read = read_run_log(log.string(), "", on_damage);
        if (read.damage.empty()) {
          ++taken;
          std::fprintf(stderr, "taken for whole: seed %llu\n",
                       static_cast<unsigned long long>(seed));
          break;
        }
      } catch (const BadInput&) {
      }
    }
  }
  return taken;
}

void read_in_child(const fs::path& log, const std::vector<test::RawEvent>& whole,
                   std::uint64_t first, std::uint64_t end, Outcome& outcome) {
  const pid_t child = fork();
  if (child == 0) {
    limit();
    _exit(std::min(200, taken_of(log, whole, first, end)));
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (!WIFEXITED(status)) {
    ++outcome.ended;
    return;
  }
  outcome.taken += WEXITSTATUS(status);
  outcome.refused += static_cast<long>(end - first) - WEXITSTATUS(status);
}

void run(const std::vector<std::string>& arguments, Outcome& outcome) {
  const pid_t child = fork();
  if (child == 0) {
    limit();
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (const std::string& text : arguments) argv.push_back(const_cast<char*>(text.c_str()));
    argv.push_back(nullptr);
    if (!std::freopen("/dev/null", "w", stdout) || !std::freopen("/dev/null", "w", stderr))
      _exit(127);
    execv(argv[0], argv.data());
    _exit(127);
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (!WIFEXITED(status) || WEXITSTATUS(status) > 2)
    ++outcome.ended;
  else
    ++(WEXITSTATUS(status) == 2 ? outcome.refused : outcome.taken);
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "damaged_logs TWINRATE [COUNT] [SEED]\n");
    return 2;
  }
  const std::string twinrate = argv[1];
  const std::uint64_t count = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 10000;
  const std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
  char name[] = "/tmp/damaged-logs-XXXXXX";
  if (!mkdtemp(name)) return 3;
  const fs::path log = fs::path(name) / "log.lcm";
  const auto whole = test::small_log(Config::load("dilys2021"), 60);
  Outcome readers, programs;
  for (std::uint64_t i = 0; i < count; i += kAtOnce)
    read_in_child(log, whole, seed + i, seed + std::min(count, i + kAtOnce), readers);
  for (std::uint64_t i = 0; i < count; i += kEveryProgram) {
    write_log(log, whole, seed + i);
    run({twinrate, "export", log, "--format", "csv", "--force", "--resample", "1000"}, programs);
    run({twinrate, "report", log, "--force"}, programs);
    run({twinrate, "trace", "dilys2021", "--data", log, "--out", name + std::string("/out")},
        programs);
    run({twinrate, "replay", log, "--speed", "1000", "--lcm-url", "memq://"}, programs);
  }
  for (const auto& [what, o] : {std::pair{"readers", readers}, {"programs", programs}})
    std::printf("%-9s %6ld refused, %ld taken for whole, %ld ended by a signal\n", what, o.refused,
                o.taken, o.ended);
  fs::remove_all(name);
  return readers.taken + readers.ended + programs.taken + programs.ended == 0 ? 0 : 1;
} catch (...) {
  return twinrate::report_error("damaged_logs");
}

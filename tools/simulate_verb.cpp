// twinrate simulate: runs the loop in one process; the log equals that of `launch --pace lockstep`,
// bit for bit.
#include "tools/simulate_verb.hpp"

#include <fmt/format.h>
#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <utility>

#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "loop/load_drive.hpp"
#include "loop/trial_run.hpp"
#include "monitor/monitor_parameters.hpp"
#include "run/progress.hpp"
#include "run/run_result.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

// The log, the page and their parts are megabytes each. Without this the heap would shrink and grow with every one, and
// the kernel would clear each page again. The heap takes addresses here, and memory as it is used, in pages of 2 MB
// if the kernel has them. It grows from a multiple of 2 MB. malloc() writes there before madvise(), so the first 2 MB
// have a small page already: they are collapsed into a large one.
void keep_freed_memory() {
  constexpr int kHeap = 64 << 20, kBlock = 1 << 20;
  constexpr std::uintptr_t kHugePage = 2 << 20;
  constexpr int kCollapse = 25;          // MADV_COLLAPSE of Linux 6.1; an older kernel refuses it
  mallopt(M_MMAP_THRESHOLD, kHeap / 2);  // the largest that glibc takes
  mallopt(M_TRIM_THRESHOLD, 2 * kHeap);
  mallopt(M_TOP_PAD, kHeap);
  const auto end_of_heap = reinterpret_cast<std::uintptr_t>(sbrk(0));
  sbrk(static_cast<std::intptr_t>((kHugePage - end_of_heap % kHugePage) % kHugePage));
  char* const begin = static_cast<char*>(sbrk(0));
  void* volatile grows_the_heap = std::malloc(kBlock);
  std::free(grows_the_heap);
  if (char* const end = static_cast<char*>(sbrk(0)); end > begin)
    if (madvise(begin, static_cast<std::size_t>(end - begin), MADV_HUGEPAGE) == 0)
      madvise(begin, kHugePage, kCollapse);
}

}  // namespace

int simulate(const SimulateOptions& o, const MakeFilter& make) {
  std::vector<std::string> overrides = o.overrides;
  if (o.duration == kEndless)
    throw BadInput("--duration inf: allowed with twinrate launch; simulate needs an end, e.g. 2s");
  if (!o.duration.empty()) overrides.push_back(duration_override(o.duration));
  if (o.monitor) overrides.push_back("monitor.enabled=true");
  Config config = load_drive(o.drive, overrides);
  if (config.drive().plant.kind == PlantKind::kBridge)
    throw BadInput(fmt::format("{}: plant.kind: simulated allowed with simulate, found bridge",
                               config.where("plant.kind")));
  if (config.read<MonitorParameters>().enabled && !o.make_monitor) refuse_absent("monitor.enabled");
  for (const std::string& warning : check_by_trial(config, Trial::kOfReasons))
    fmt::print(stderr, "twinrate: warning: {}\n", warning);
  if (!o.quiet) catch_stop_signals();
  const auto result = make_run_directory(o.run_dir, config, o.force);
  const std::string& directory = result->path();
  const auto begun = std::chrono::steady_clock::now();
  RunFacts facts;
  facts.how = "simulate, one process";
  facts.ended = run_simulated(config, directory, o.json, make, &facts.kept, o.make_monitor);
  facts.wall_s = seconds_since(begun);
  facts.quiet = o.quiet;
  if (!facts.ended.empty()) fmt::print(stderr, "twinrate: {}\n", facts.ended);
  const int code = conclude_run(directory, config, std::move(facts));
  result->finish();
  return code;
}

void add_simulate_verb(CLI::App& app, int& exit_code, MakeTickWatch make_monitor) {
  auto o = std::make_shared<SimulateOptions>();
  o->make_monitor = make_monitor;
  CLI::App* verb =
      app.add_subcommand("simulate", "Run the whole loop in one process, without a bus");
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--duration", o->duration, "set the drive time, e.g. 2s or 500ms");
  verb->add_option("--run-dir", o->run_dir,
                   "write the run into this directory (default runs/NAME-DATE)");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_flag("--monitor", o->monitor,
                 "watch the run, trace and propose effects (as monitor.enabled = true)");
  verb->add_flag("--force", o->force, "replace the run that the directory holds");
  verb->add_flag("--json", o->json, "print progress as JSON lines");
  verb->callback([o, &exit_code] {
    keep_freed_memory();
    exit_code = simulate(*o);
  });
}

}  // namespace twinrate

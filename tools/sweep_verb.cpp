// twinrate sweep fb: the slowest gain update rate f_bmin that keeps synchronism. sweep merge:
// merges shards.
#include <fmt/format.h>

#include <filesystem>

#include "core/paths.hpp"
#include "core/process.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "sweep/cost.hpp"
#include "sweep/figure.hpp"
#include "sweep/merge.hpp"
#include "sweep/run.hpp"
#include "sweep/store.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using namespace sweep;

struct SweepOptions {
  Plan plan;
  std::string out, shard;
  bool resume = false, json = false, force = false;
};

std::string shard_directory(const SweepOptions& o) {
  if (o.plan.shards == 1) return o.out;
  return fmt::format("{}/shard-{}-of-{}", o.out, o.plan.shard, o.plan.shards);
}

int sweep_fb(SweepOptions o) {
  if (!o.shard.empty())
    set_shard(o.plan, o.shard);
  else
    set_shard_from_launcher(o.plan);
  check(o.plan);
  if (!o.plan.log.empty()) {
    o.plan.speeds_Hz = {recorded_f_e_Hz(read_run_log(o.plan.log), o.plan)};
    o.plan.seeds = 1;
  }
  Config config = load_drive(o.plan.drive, o.plan.overrides);
  o.plan.start_takes_s = start_takes_s(config);
  if (o.plan.log.empty()) expect_speeds_reached(o.plan, config.drive());
  const std::string directory = shard_directory(o);
  ResultDirectory result(directory, ResultKind::kSweep, o.force, o.resume);
  catch_stop_signals();
  const bool stopped = run_searches(o.plan, config, result, {.resume = o.resume, .json = o.json});
  if (stopped) {
    fmt::print(
        stderr,
        "twinrate: interrupted; {}/points.csv keeps the finished points, --resume continues\n",
        directory);
    return 1;
  }
  if (o.plan.shards == 1)  // sweep merge writes the result of shards
    write_result(o.plan, config, directory, read_points(directory + "/points.csv"), o.json);
  result.finish();
  return 0;
}

void add_options(CLI::App& verb, SweepOptions& o) {
  Plan& p = o.plan;
  verb.add_option("DRIVE", p.drive, "sweep this drive file or preset")->required();
  verb.add_option("--speeds", p.speeds_Hz,
                  "set the electrical frequencies f_e, Hz, separated by commas")
      ->delimiter(',');
  verb.add_option("--policies", p.policies, "set the gain policies, separated by commas")
      ->delimiter(',')
      ->default_val(std::vector<std::string>{"paper"});
  verb.add_option("--seeds", p.seeds, "run every point with this many noise seeds (default 5)");
  verb.add_option("--out", o.out, "write the result into this directory")->required();
  verb.add_option("--start", p.start,
                  "choose the start: ramp, from standstill; switched, at speed with n = 1, then n "
                  "(default ramp)");
  verb.add_option("--ramp-rad-s2", p.ramp_rad_s2,
                  "set the electrical acceleration of the start, rad/s2 (default 16000)");
  verb.add_option("--n-max", p.n_max, "end the search at this n (default 200)");
  verb.add_option(
      "--load", p.load_pu,
      "set the load, per unit of the rated torque (default: the load of the drive file)");
  verb.add_option(
      "--over", p.over,
      "choose the loop: inprocess, or lcm for the process set over the bus (default inprocess)");
  verb.add_option("--engine", p.engine,
                  "choose the engine: lanes, many drives at once if the drive allows it; "
                  "reference, one by one");
  verb.add_option("--shard", o.shard,
                  "run part i of n, i/n with i from 0 (default: the rank of "
                  "mpirun or srun)");
  verb.add_option(
      "--log", p.log,
      "run the filter of DRIVE alone on this recorded drive, against its measured angle");
  verb.add_option("--set", p.overrides,
                  "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  CLI::Option* resume = verb.add_flag("--resume", o.resume, "continue a sweep that was stopped");
  verb.add_flag("--force", o.force, "replace the sweep that --out holds")->excludes(resume);
  verb.add_flag("--json", o.json, "print progress as JSON lines");
}

void add_fb(CLI::App& sweep, int& exit_code) {
  auto o = std::make_shared<SweepOptions>();
  CLI::App* verb = sweep.add_subcommand(
      "fb", "Find f_bmin against f_e; write points.csv, fbmin.csv, why.csv, figure.svg");
  add_options(*verb, *o);
  verb->callback([o, &exit_code] { exit_code = sweep_fb(*o); });
}

void add_merge(CLI::App& sweep) {
  CLI::App* verb = sweep.add_subcommand("merge", "Merge the shards of one sweep into one result");
  auto directories = std::make_shared<std::vector<std::string>>();
  auto out = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  verb->add_option("DIR", *directories, "read the shards of these directories")->required();
  verb->add_option("--out", *out, "write the result into this directory (default: the first DIR)");
  verb->add_flag("--json", *json, "print no table");
  auto force = std::make_shared<bool>(false);
  verb->add_flag("--force", *force, "replace the sweep that --out holds");
  verb->callback([=] { merge(*directories, *out, *json, *force); });
}

void add_figure(CLI::App& sweep) {
  CLI::App* verb = sweep.add_subcommand(
      "figure", "Draw the sweeps of several filters of one drive into one figure");
  auto sweeps = std::make_shared<std::vector<std::string>>();
  auto svg = std::make_shared<std::string>();
  verb->add_option("DIR", *sweeps, "read the results of sweep fb in these directories")->required();
  verb->add_option("--out", *svg, "write this SVG file")->required();
  verb->callback([=] { write_figure_of(*sweeps, *svg); });
}

void add_cost(CLI::App& sweep) {
  CLI::App* verb =
      sweep.add_subcommand("cost", "Print the processor load against f_b (Dilys 2021, Table 4)");
  auto halves = std::make_shared<Halves>();
  auto f_s_Hz = std::make_shared<double>(5000), a_turn = std::make_shared<double>(7);
  auto f_b_Hz =
      std::make_shared<std::vector<double>>(std::vector<double>{5000, 2500, 1250, 1000, 500, 50});
  verb->add_option("--fast-s", halves->fast_s, "set the time of one fast step, s (default 6.1e-6)")
      ->check(above_zero());
  verb->add_option("--background-s", halves->background_s,
                   "set the time of one background step, s (default 31.6e-6)")
      ->check(above_zero());
  verb->add_option("--f-s-hz", *f_s_Hz, "set the control rate f_s, Hz (default 5000)")
      ->check(above_zero());
  verb->add_option("--f-b-hz", *f_b_Hz, "set the background rates f_b, Hz, separated by commas")
      ->delimiter(',')
      ->check(above_zero());
  verb->add_option("--gains-a-turn", *a_turn,
                   "set the gain updates per electrical turn that the policy needs (default 7)")
      ->check(above_zero());
  verb->callback([=] {
    const std::string results = data_directory() + "/bench/results/";
    const auto host = read_counts(results + "instructions.json");
    const auto cortex = read_cortex_counts(results + "cortex_m3.json");
    fmt::print("{}", cost_table(*halves, cortex ? cortex : host, *f_s_Hz, *f_b_Hz, *a_turn));
    if (cortex && host) fmt::print("{}", propagated_table(*host, *f_s_Hz));
  });
}

}  // namespace

void add_sweep_verb(CLI::App& app, int& exit_code) {
  CLI::App* verb = app.add_subcommand(
      "sweep", "Find the slowest gain update rate f_bmin that keeps synchronism");
  verb->require_subcommand(1);
  add_fb(*verb, exit_code);
  add_merge(*verb);
  add_figure(*verb);
  add_cost(*verb);
}

}  // namespace twinrate

// twinrate sweep fb: how slowly may the gain be computed? And sweep merge: one result out of
// shards.
#include <fmt/format.h>

#include <filesystem>

#include "core/process.hpp"
#include "loop/load_drive.hpp"
#include "sweep/cost.hpp"
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
  bool resume = false, json = false;
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
    o.plan.speeds_Hz = {recorded_f_e_Hz(read_run_log(o.plan.log))};
    o.plan.seeds = 1;
  }
  const Config config = load_drive(o.plan.drive, o.plan.overrides);
  const std::string directory = shard_directory(o);
  catch_stop_signals();
  const bool stopped =
      run_searches(o.plan, config, {.directory = directory, .resume = o.resume, .json = o.json});
  if (stopped) {
    fmt::print(stderr,
               "twinrate: interrupted; {}/points.csv keeps what is there, --resume goes "
               "on\n",
               directory);
    return 1;
  }
  if (o.plan.shards > 1) return 0;  // sweep merge
  write_result(o.plan, config, directory, read_points(directory + "/points.csv"), o.json);
  return 0;
}

void add_options(CLI::App& verb, SweepOptions& o) {
  Plan& p = o.plan;
  verb.add_option("DRIVE", p.drive, "drive file or preset")->required();
  verb.add_option("--speeds", p.speeds_Hz, "electrical frequencies, Hz")->delimiter(',');
  verb.add_option("--policies", p.policies, "gain policies")
      ->delimiter(',')
      ->default_val(std::vector<std::string>{"paper"});
  verb.add_option("--seeds", p.seeds, "runs of every point, each with its own noise (5)");
  verb.add_option("--out", o.out, "directory of the result")->required();
  verb.add_option("--start", p.start, "ramp: from standstill; switched: n = 1 at speed, then n");
  verb.add_option("--ramp-rad-s2", p.ramp_rad_s2, "electrical acceleration of the start (16000)");
  verb.add_option("--n-max", p.n_max, "cap of the search (200)");
  verb.add_option("--load", p.load_pu, "load in rated torques (0)");
  verb.add_option("--over", p.over, "inprocess, or lcm: through the real process set");
  verb.add_option("--engine", p.engine,
                  "lanes: many drives at once, where the drive allows it; reference: one by one");
  verb.add_option("--shard", o.shard,
                  "i/n: the i-th of n parts, from 0 (default: the rank of "
                  "mpirun or srun)");
  verb.add_option("--log", p.log, "a recorded drive: the filter alone, against its angle");
  verb.add_option("--set", p.overrides, "key.path=value")->allow_extra_args(false);
  verb.add_flag("--resume", o.resume, "go on where an earlier sweep was stopped");
  verb.add_flag("--json", o.json, "progress as JSON lines");
}

}  // namespace

void add_sweep_verb(CLI::App& app, int& exit_code) {
  CLI::App* verb = app.add_subcommand("sweep", "how slowly may the gain be computed?");
  verb->require_subcommand(1);
  auto o = std::make_shared<SweepOptions>();
  CLI::App* fb = verb->add_subcommand("fb", "f_bmin against f_e: points.csv, fbmin.csv, figure");
  add_options(*fb, *o);
  fb->callback([o, &exit_code] { exit_code = sweep_fb(*o); });
  CLI::App* merge_verb = verb->add_subcommand("merge", "one result out of shards");
  auto directories = std::make_shared<std::vector<std::string>>();
  auto out = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  merge_verb->add_option("DIR", *directories, "directories of shards")->required();
  merge_verb->add_option("--out", *out, "where the result is written (the first DIR)");
  merge_verb->add_flag("--json", *json, "no table");
  CLI::App* cost = verb->add_subcommand("cost", "processor load against f_b (Dilys 2021, Table 4)");
  auto halves = std::make_shared<Halves>();
  auto f_s_Hz = std::make_shared<double>(5000), a_turn = std::make_shared<double>(7);
  auto f_b_Hz =
      std::make_shared<std::vector<double>>(std::vector<double>{5000, 2500, 1250, 1000, 500, 50});
  cost->add_option("--fast-s", halves->fast_s, "time of one fast step (6.1e-6)");
  cost->add_option("--background-s", halves->background_s, "of one background step (31.6e-6)");
  cost->add_option("--f-s-hz", *f_s_Hz, "control rate (5000)");
  cost->add_option("--f-b-hz", *f_b_Hz, "background rates")->delimiter(',');
  cost->add_option("--gains-a-turn", *a_turn, "gains an electrical turn that the policy needs (7)");
  cost->callback([=] { fmt::print("{}", cost_table(*halves, *f_s_Hz, *f_b_Hz, *a_turn)); });
  merge_verb->callback([=] { merge(*directories, *out, *json); });
}

}  // namespace twinrate

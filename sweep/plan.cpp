#include "sweep/plan.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <nlohmann/json.hpp>

namespace twinrate::sweep {
namespace {

constexpr double kSwitch_s = 0.2;
constexpr int kSingleStepsUpTo = 64;

int environment_number(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text && *text ? std::atoi(text) : otherwise;
}

}  // namespace

void check(const Plan& plan) {
  for (const std::string& policy : plan.policies)
    if (std::find(std::begin(kGainPolicyNames), std::end(kGainPolicyNames), policy) ==
        std::end(kGainPolicyNames))
      throw BadInput(fmt::format("--policies: one of {} allowed, found {}",
                                 fmt::join(kGainPolicyNames, ", "), policy));
  for (double f_e : plan.speeds_Hz)
    if (!(f_e > 0 && f_e <= 5000))
      throw BadInput(fmt::format("--speeds: above 0 and up to 5000 Hz allowed, found {}", f_e));
  if (plan.policies.empty()) throw BadInput("--policies: none given");
  if (plan.speeds_Hz.empty() && plan.log.empty()) throw BadInput("--speeds: none given");
  if (plan.seeds < 1) throw BadInput("--seeds: 1 or more allowed");
  if (plan.n_max < 1 || plan.n_max > 100000) throw BadInput("--n-max: 1 to 100000 allowed");
  if (plan.start != "ramp" && plan.start != "switched")
    throw BadInput(fmt::format("--start: ramp or switched allowed, found {}", plan.start));
  if (plan.over != "inprocess" && plan.over != "lcm")
    throw BadInput(fmt::format("--over: inprocess or lcm allowed, found {}", plan.over));
  if (plan.engine != "lanes" && plan.engine != "reference")
    throw BadInput(fmt::format("--engine: lanes or reference allowed, found {}", plan.engine));
  if (!(plan.ramp_rad_s2 > 0)) throw BadInput("--ramp-rad-s2: above 0 allowed");
}

std::vector<Search> searches(const Plan& plan) {
  std::vector<Search> list;
  for (const std::string& policy : plan.policies)
    for (double f_e : plan.speeds_Hz)
      for (int seed = 1; seed <= plan.seeds; ++seed) list.push_back({policy, f_e, seed});
  return list;
}

void set_shard(Plan& plan, const std::string& text) {
  int end = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &plan.shard, &plan.shards, &end) != 2 ||
      static_cast<std::size_t>(end) != text.size() || plan.shards < 1 || plan.shard < 0 ||
      plan.shard >= plan.shards)
    throw BadInput(fmt::format("--shard: i/n with i from 0 to n-1 allowed, found {}", text));
}

bool set_shard_from_launcher(Plan& plan) {
  constexpr const char* kNames[][2] = {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                       {"PMI_RANK", "PMI_SIZE"},
                                       {"SLURM_PROCID", "SLURM_NTASKS"}};
  for (const auto& [rank, size] : kNames) {
    const int ranks = environment_number(size, 0);
    if (ranks < 2) continue;
    plan.shards = ranks;
    plan.shard = environment_number(rank, 0);
    return true;
  }
  return false;
}

// Window of the verdict: starts 0.5 s after the end of the ramp (0.3 s after the switch), another
// 0.5 s later with a load. A start of align_if delays the ramp. Length: 1 s, five electrical turns or
// three gains, the longest of these.
PointTimes point_times(const Plan& plan, const DriveConfig& base, double f_e_Hz, int n) {
  const double T_s = base.T_s();
  PointTimes times{.settle_s = plan.start_takes_s + kTwoPi * f_e_Hz / plan.ramp_rad_s2 + 0.5};
  if (plan.start == "switched") {
    const double switch_s = std::ceil(kSwitch_s / T_s / n) * n * T_s;
    times.n_from_s = switch_s - 0.5 * T_s;
    times.settle_s = switch_s + 0.3;
  }
  if (plan.load_pu.value_or(0) != 0) times.settle_s += 0.5;
  times.duration_s = times.settle_s + std::max({1.0, 5 / f_e_Hz, 3 * n * T_s});
  return times;
}

std::vector<std::string> point_overrides(const Plan& plan, const DriveConfig& base,
                                         const Search& search, int n) {
  const PointTimes times = point_times(plan, base, search.f_e_Hz, n);
  std::vector<std::string> list = plan.overrides;
  const auto set = [&](const std::string& key, auto value) {
    list.push_back(fmt::format("{}={}", key, value));
  };
  set("gain.policy", search.policy);
  set("rates.f_b_Hz", 0);
  set("rates.n", n);
  set("rates.n_from", "start");  // the limit is that of n from the first tick on
  set("run.seed", search.seed);
  if (base.reference.in_rpm)
    set("reference.speed_rpm", 60 * search.f_e_Hz / base.machine.n_p);
  else
    set("reference.omega_e_rad_s", kTwoPi * search.f_e_Hz);
  set("reference.slew_rad_s2", plan.ramp_rad_s2);
  if (plan.start == "switched") {
    set("start", "flying");
    set("rates.n_from_s", times.n_from_s);
  }
  if (plan.load_pu) set("load.T_load_Nm", *plan.load_pu * base.machine.T_rated);
  set("run.settle_s", times.settle_s);
  set("run.duration_s", times.duration_s);
  return list;
}

std::string command_of(const Plan& p) {
  const Plan usual;
  std::string text =
      fmt::format("twinrate sweep fb {} --speeds {} --policies {} --seeds {}", p.drive,
                  fmt::join(p.speeds_Hz, ","), fmt::join(p.policies, ","), p.seeds);
  const auto add = [&](const char* option, const auto& value, const auto& other) {
    if (value != other) text += fmt::format(" {} {}", option, value);
  };
  add("--start", p.start, usual.start);
  add("--ramp-rad-s2", p.ramp_rad_s2, usual.ramp_rad_s2);
  add("--n-max", p.n_max, usual.n_max);
  if (p.load_pu) text += fmt::format(" --load {}", *p.load_pu);
  add("--over", p.over, usual.over);
  add("--engine", p.engine, usual.engine);
  add("--log", p.log, usual.log);
  for (const std::string& set : p.overrides) text += " --set " + set;
  return text;
}

int next_n(int held) {
  return held < kSingleStepsUpTo ? held + 1 : held + std::max(1, held / 20);
}

std::string identity(const Plan& p, const Config& config) {
  const nlohmann::ordered_json json = {
      {"drive", p.drive},
      {"overrides", p.overrides},
      {"config", config.resolved()},
      {"speeds_Hz", p.speeds_Hz},
      {"policies", p.policies},
      {"seeds", p.seeds},
      {"start", p.start},
      {"ramp_rad_s2", p.ramp_rad_s2},
      {"n_max", p.n_max},
      {"load_pu", p.load_pu ? nlohmann::ordered_json(*p.load_pu) : nlohmann::ordered_json(nullptr)},
      {"over", p.over},
      {"engine", p.engine},
      {"log", p.log}};
  return json.dump(1);
}

Plan plan_of(const std::string& sweep_json) try {
  const auto json = nlohmann::json::parse(sweep_json);
  Plan p;
  json.at("drive").get_to(p.drive);
  json.at("overrides").get_to(p.overrides);
  json.at("speeds_Hz").get_to(p.speeds_Hz);
  json.at("policies").get_to(p.policies);
  json.at("seeds").get_to(p.seeds);
  json.at("start").get_to(p.start);
  json.at("ramp_rad_s2").get_to(p.ramp_rad_s2);
  json.at("n_max").get_to(p.n_max);
  if (json.at("load_pu").is_number()) p.load_pu = json.at("load_pu").get<double>();
  json.at("over").get_to(p.over);
  p.engine = json.value("engine", "reference");
  json.at("log").get_to(p.log);
  return p;
} catch (const nlohmann::json::exception& error) {
  throw BadInput(fmt::format("sweep.json is not that of a sweep: {}", error.what()));
}

}  // namespace twinrate::sweep

// twinrate tune DRIVE.toml --log LOG [--holdout LOG]: noise weights of the filter from a recorded drive.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/output_file.hpp"
#include "core/process.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"
#include "tune/tune.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kDegrees = 180 / kPi;

struct TuneOptions {
  tune::Request request;
  std::string out;
  bool json = false, force = false;
};

Json consistency_json(const tune::Consistency& c) {
  const auto number = [](const std::optional<double>& x) { return x ? Json(*x) : Json(); };
  return {{"ticks", c.ticks},
          {"nis", c.nis},
          {"inside_95", c.inside},
          {"autocorrelation", c.autocorrelation},
          {"log_likelihood", c.log_likelihood},
          {"locked", c.locked ? Json(*c.locked) : Json()},
          {"angle_error_rms_rad", number(c.angle_error_rms)},
          {"speed_error_rms_rad_s", number(c.speed_error_rms)}};
}

Json side_json(const tune::Side& side) {
  Json weights = Json::object();
  for (const auto& [key, values] : side.knobs.keys) weights[key] = values;
  return {{"weights", weights},
          {"training", consistency_json(side.training)},
          {"holdout", consistency_json(side.holdout)},
          {"n_max", side.n_max ? Json(*side.n_max) : Json()},
          {"closed_loop_locked", side.closed_loop}};
}

std::string number_text(const std::optional<double>& x) {
  return x ? fmt::format("{:.4g}", *x) : "unknown";
}

std::string n_max_text(const std::optional<int>& n, int most, double f_s_Hz) {
  if (!n) return "unknown";
  if (*n == 0) return "lost at n = 1";
  return fmt::format("{}n = {} ({:.4g} Hz)", *n >= most ? "above " : "", *n, f_s_Hz / *n);
}

void print_row(const std::string& name, const std::string& before, const std::string& after) {
  fmt::print("  {:<44} {:>20} {:>20}\n", name, before, after);
}

void print_weights(const tune::Side& before, const tune::Side& after) {
  for (std::size_t i = 0; i < before.knobs.list.size(); ++i) {
    const tune::Knob& knob = before.knobs.list[i];
    std::string name = knob.key.substr(knob.key.rfind('.') + 1), places;
    for (int place : knob.index) places += fmt::format("{}{}", places.empty() ? "" : ", ", place);
    if (!places.empty()) name += "[" + places + "]";
    print_row(name, fmt::format("{:.4g}", knob.value),
              fmt::format("{:.4g}", after.knobs.list[i].value));
  }
}

void print_result(const TuneOptions& o, const tune::Result& r) {
  const tune::Consistency &before = r.before.holdout, &after = r.after.holdout;
  const auto row = [](const char* name, double a, double b) {
    print_row(name, fmt::format("{:.4g}", a), fmt::format("{:.4g}", b));
  };
  const auto degrees = [](std::optional<double> x) {
    if (x) *x *= kDegrees;
    return number_text(x);
  };
  print_row("", "drive file", "tuned");
  print_weights(r.before, r.after);
  fmt::print("unseen data: {} ticks of {}\n", after.ticks,
             o.request.holdout.empty() ? "the last third of " + o.request.log : o.request.holdout);
  row("NIS per output (consistent: 1)", before.nis, after.nis);
  row("ticks within 95 % bounds (consistent: 0.95)", before.inside, after.inside);
  row("autocorrelation of innovations (white: 0)", before.autocorrelation, after.autocorrelation);
  row("log-likelihood of a tick", before.log_likelihood, after.log_likelihood);
  print_row("angle error rms, deg electrical", degrees(before.angle_error_rms),
            degrees(after.angle_error_rms));
  print_row("speed error rms, rad/s", number_text(before.speed_error_rms),
            number_text(after.speed_error_rms));
  print_row(fmt::format("slowest gain update, filter alone{}",
                        r.f_e_Hz ? fmt::format(" at {:.1f} Hz", *r.f_e_Hz) : ""),
            n_max_text(r.before.n_max, o.request.n_most, r.f_s_Hz),
            n_max_text(r.after.n_max, o.request.n_most, r.f_s_Hz));
  const auto held = [](const tune::Side& side) { return side.closed_loop ? "locked" : "lost"; };
  print_row("simulated run of the drive file", held(r.before), held(r.after));
  if (r.back > 0)
    fmt::print(
        "The most likely weights do not hold the simulated run and the n of the drive file's: "
        "these lie {:.0f} % of the\n"
        "way back to them.\n",
        100 * r.back);
  if (r.interrupted) fmt::print("Interrupted: the best weights so far.\n");
  if (r.objections.empty())
    fmt::print("The tuned weights describe the unseen data better than those of the drive file.\n");
  for (const std::string& objection : r.objections)
    fmt::print("Against the tuned weights: {}.\n", objection);
  fmt::print("\n{}", r.after.knobs.table());
}

Json result_json(const tune::Result& r) {
  return {{"before", side_json(r.before)},
          {"after", side_json(r.after)},
          {"f_s_Hz", r.f_s_Hz},
          {"way_back", r.back},
          {"f_e_Hz", r.f_e_Hz ? Json(*r.f_e_Hz) : Json()},
          {"better", r.objections.empty()},
          {"objections", r.objections},
          {"interrupted", r.interrupted}};
}

// The drive file with the tuned weights, every key written out.
void write_drive(const TuneOptions& o, const tune::Result& r) {
  std::vector<std::string> overrides = o.request.overrides;
  for (const std::string& text : r.after.knobs.overrides()) overrides.push_back(text);
  const std::string resolved = load_drive(o.request.drive, overrides).resolved();
  (o.force ? replace_file : write_new)(o.out, resolved);
}

int tune_drive(const TuneOptions& o) {
  if (!o.out.empty()) expect_free(o.out, o.force);
  catch_stop_signals();
  const bool draws = !o.json && isatty(STDERR_FILENO) != 0;
  const auto progress = [&](const std::string& what, double share) {
    if (o.json) {
      fmt::print("{}\n", Json{{"progress", what}, {"share", share}}.dump());
      std::fflush(stdout);
    } else if (draws) {
      fmt::print(stderr, "\r\033[K{} {:.0f} %", what, 100 * share);
    }
  };
  const tune::Result r = tune::tune(o.request, progress, [] { return stop_signalled(); });
  if (draws) fmt::print(stderr, "\r\033[K");
  if (o.json)
    std::cout << result_json(r).dump() << "\n";
  else
    print_result(o, r);
  if (!o.out.empty()) write_drive(o, r);
  return 0;
}

}  // namespace

void add_tune_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<TuneOptions>();
  CLI::App* verb =
      app.add_subcommand("tune", "Find the noise weights of the filter from a recorded drive");
  verb->add_option("DRIVE", o->request.drive, "read this drive file or preset")->required();
  verb->add_option("--log", o->request.log, "tune on this run directory or log")->required();
  verb->add_option("--holdout", o->request.holdout,
                   "judge on this run directory or log; default: the last third of --log");
  verb->add_option("--out", o->out, "write the drive file with the tuned weights");
  verb->add_flag("--force", o->force, "replace that file")->needs("--out");
  verb->add_option("--set", o->request.overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_option("--n-max", o->request.n_most, "search the slowest gain update up to this n")
      ->check(CLI::Range(1, 2000));
  verb->add_option("--evaluations", o->request.evaluations,
                   "evaluate the likelihood at most this often")
      ->check(CLI::Range(1, 10000));
  verb->add_flag("--json", o->json, "print JSON lines");
  verb->callback([o, &exit_code] { exit_code = tune_drive(*o); });
}

}  // namespace twinrate

#include "tools/plan_verb.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/option_values.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/result_directory.hpp"
#include "run/progress.hpp"

namespace twinrate {
namespace {

double seconds_of(const std::string& text) {
  const std::string number = seconds_text(text);
  char* end = nullptr;
  const double seconds = std::strtod(number.c_str(), &end);
  if (number.empty() || *end != 0 || !(seconds > 0))
    throw BadInput("--duration " + text + ": a time like 10s or 500ms");
  return seconds;
}

std::vector<std::string> names_of(const std::string& list) {
  std::vector<std::string> names;
  std::istringstream text(list);
  for (std::string name; std::getline(text, name, ',');)
    if (!name.empty()) names.push_back(name);
  return names;
}

// Progress on a terminal or as JSON lines.
class PlanProgress {
 public:
  explicit PlanProgress(bool json_lines)
      : json_(json_lines), terminal_(isatty(STDERR_FILENO) != 0) {}
  ~PlanProgress() {
    if (drawn_) fmt::print(stderr, "\r\033[K");
  }
  void show(const std::string& what, double share) {
    const auto now = std::chrono::steady_clock::now();
    if (what == last_what_ && now - last_ < std::chrono::milliseconds(json_ ? 500 : 100)) return;
    last_what_ = what;
    last_ = now;
    if (json_) {
      fmt::print("{}\n", nlohmann::json{{"progress", what}, {"share", share}}.dump());
      std::fflush(stdout);
    } else if (terminal_) {
      fmt::print(stderr, "\r\033[K{} {:.0f} %", what, 100 * share);
      drawn_ = true;
    }
  }

 private:
  bool json_, terminal_, drawn_ = false;
  std::string last_what_;
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace

CLI::Option* add_plan_options(CLI::App& verb, PlanOptions& o) {
  CLI::Option* plan = verb.add_flag(
      "--plan", o.wanted,
      "propose a run that separates the candidates; with --data, a run that adds to those "
      "logs; write plan.toml, plan.json, plan.svg");
  const auto option = [&](const char* name, auto& value, const char* what) {
    return verb.add_option(name, value, what)->needs(plan);
  };
  option("--duration", o.duration, "--plan: limit the length of the run, e.g. 10s");
  option("--kinds", o.kinds,
         "--plan: plan for these kinds of effects only, separated by commas (default: all)");
  option("--max-speed", o.request.speed_max_rpm, "--plan: limit the speed, rpm")
      ->check(above_zero());
  option("--max-current", o.request.i_max_A, "--plan: limit the current amplitude, A")
      ->check(above_zero());
  option("--max-load", o.request.T_load_max_Nm, "--plan: limit the torque of the load machine, Nm")
      ->check(zero_or_more());
  verb.add_flag("--no-load-machine", o.no_load_machine, "--plan: plan without a load machine")
      ->needs(plan);
  verb.add_flag("--one-direction", o.one_direction, "--plan: turn the shaft forwards only")
      ->needs(plan);
  return plan;
}

int plan_measurement(const PlanOptions& o, const Config& drive, const PlanOutput& output,
                     const std::function<std::vector<PlanLog>()>& logs) {
  const std::string& out = output.directory;
  ResultDirectory directory(out, ResultKind::kPlan, output.force);
  PlanRequest request = o.request;
  request.kinds = names_of(o.kinds);
  request.longest_s = seconds_of(o.duration);
  request.load_machine = !o.no_load_machine;
  request.reverse = !o.one_direction;
  catch_stop_signals();
  Plan plan;
  {
    PlanProgress progress(output.json_lines);
    plan = make_plan(drive, request, logs(),
                     {[&](const std::string& what, double share) { progress.show(what, share); },
                      stop_signalled});
  }
  directory.begin();
  write_new(out + "/plan.json", plan_json(plan));
  std::string files = "plan.json";
  if (!plan.order.empty()) {
    write_new(out + "/plan.toml", plan_toml(drive, plan));
    write_new(out + "/plan.svg", plan_svg(plan));
    files = "plan.toml, plan.json, plan.svg";
  }
  directory.finish();
  if (output.json_lines) {
    fmt::print("{}\n", nlohmann::json{{"sentence", plan.sentence}, {"out", out}}.dump());
    return 0;
  }
  fmt::print("{}\n{}", plan.sentence, plan_table(plan));
  if (!plan.checked && !plan.order.empty())
    fmt::print("interrupted: the figures are those of the blocks, not of the whole run\n");
  fmt::print("{}/{}\n", out, files);
  return 0;
}

}  // namespace twinrate

// twinrate response speed|current|load DRIVE.toml: frequency response beside that of the design.
#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "core/output_file.hpp"
#include "core/percent_line.hpp"
#include "core/process.hpp"
#include "loop/load_drive.hpp"
#include "response/response.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

constexpr const char* kFiles[] = {".csv", ".json", ".svg"};

struct ResponseOptions {
  std::string of, drive, out, n;
  std::vector<std::string> overrides;
  bool force = false, json = false;
};

std::vector<int> values_of_n(const ResponseOptions& o) {
  if (o.n.empty()) return {load_drive(o.drive, o.overrides).drive().rates.n};
  std::vector<int> list;
  std::istringstream text(o.n);
  for (std::string word; std::getline(text, word, ',');) {
    const bool digits = !word.empty() && word.size() < 6 &&
                        word.find_first_not_of("0123456789") == std::string::npos;
    const int n = digits ? std::stoi(word) : 0;
    if (n < 1) throw BadInput("--n " + o.n + ": whole numbers from 1 allowed, as in 1,5,10");
    list.push_back(n);
  }
  return list;
}

ResponseOf response_named(const std::string& name) {
  for (int i = 0; i < 3; ++i)
    if (name == kResponseNames[i]) return static_cast<ResponseOf>(i);
  throw BadInput(name + ": speed, current or load allowed");
}

std::ptrdiff_t measured_lines(const Response& r) {
  return std::count_if(r.lines.begin(), r.lines.end(),
                       [](const ResponseLine& l) { return l.measured(); });
}

// The option that makes the test signal larger.
const char* hint(const Response& r) {
  return r.of == ResponseOf::kSpeed ? "; a faster reference.slew_rad_s2 admits a larger one" : "";
}

void print(const Response& r) {
  fmt::print("  n = {:<4} ", r.n);
  if (!r.locked) {
    fmt::print("synchronism lost: no response\n");
    return;
  }
  double least = 1, peak = 0, design_peak = 0;
  for (const ResponseLine& l : r.lines) {
    least = std::min(least, l.coherence);
    if (l.measured()) peak = std::max(peak, std::abs(l.H));
    if (l.design) design_peak = std::max(design_peak, std::abs(*l.design));
  }
  const auto measured = measured_lines(r);
  const auto all = static_cast<std::ptrdiff_t>(r.lines.size());
  if (measured == 0) {
    fmt::print("not measured: noise and ripple hide the test signal at all {} lines{}\n", all,
               hint(r));
    return;
  }
  const auto text = [&](const std::optional<double>& f, bool known) {
    return f ? fmt::format("at {:.4g} Hz", *f) : std::string(known ? "beyond" : "not measured");
  };
  const bool has_design = r.lines.front().design.has_value();
  const auto beside = [&](const std::string& value, const std::string& design) {
    return has_design ? fmt::format("{} (design {})", value, design) : value;
  };
  const auto f_design = bandwidth(r, true);
  const std::string design_bandwidth = f_design ? fmt::format("{:.4g} Hz", *f_design) : "beyond";
  if (r.of != ResponseOf::kLoad)
    fmt::print("-3 dB {}, ", beside(text(bandwidth(r, false), measured == all), design_bandwidth));
  fmt::print("largest gain {}, coherence at least {:.3f}\n",
             beside(fmt::format("{:.4g}", peak), fmt::format("{:.4g}", design_peak)), least);
  if (measured < all)
    fmt::print(
        "           {} of {} lines are not measured and left out: noise and ripple hide the test "
        "signal{}\n",
        all - measured, all, hint(r));
}

int run(ResponseOptions o) {
  const ResponseOf of = response_named(o.of);
  if (o.out.empty()) o.out = "response-" + o.of;
  for (const char* kind : kFiles) expect_free(o.out + kind, o.force);
  catch_stop_signals();
  std::vector<Response> responses;
  std::string name;
  const std::vector<int> all_n = values_of_n(o);
  for (const int n : all_n) {
    std::vector<std::string> overrides = o.overrides;
    overrides.push_back(fmt::format("rates.n={}", n));
    Config config = load_drive(o.drive, overrides);
    name = config.drive().name.empty() ? o.drive : config.drive().name;
    if (responses.empty() && !o.json) fmt::print("{}: response of the {} loop\n", name, o.of);
    {
      PercentLine line(o.json ? PercentLine::Form::kJson : PercentLine::Form::kTerminal);
      line.show(fmt::format("measuring n = {},", n),
                static_cast<double>(responses.size()) / static_cast<double>(all_n.size()));
      responses.push_back(measure_response(config, of, stop_signalled));
    }
    if (stop_signalled()) throw Stopped{};
    if (!o.json) print(responses.back());
  }
  const std::string texts[] = {response_csv(responses), response_json(name, responses),
                               response_svg(name, responses)};
  for (int i = 0; i < 3; ++i) {
    (o.force ? replace_file : write_new)(o.out + kFiles[i], texts[i]);
  }
  if (o.json)
    fmt::print("{}\n", nlohmann::json{{"out", o.out}}.dump());
  else
    fmt::print("written to {0}.csv, {0}.json, {0}.svg\n", o.out);
  for (const Response& r : responses)
    if (!r.locked || measured_lines(r) == 0) return 1;
  return 0;
}

}  // namespace

void add_response_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<ResponseOptions>();
  CLI::App* verb = app.add_subcommand(
      "response", "Measure the frequency response of a closed loop beside its design");
  verb->add_option("LOOP", o->of, "measure this loop: speed, current, load")->required();
  verb->add_option("DRIVE", o->drive, "read this drive file or preset")->required();
  verb->add_option("--out", o->out,
                   "write this file name with .csv, .json and .svg (default response-LOOP)");
  verb->add_option("--n", o->n, "measure with a gain every n ticks, a list: 1,5,10");
  verb->add_option("--set", o->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false);
  verb->add_flag("--force", o->force, "replace these files");
  verb->add_flag("--json", o->json, "print JSON lines instead of text");
  verb->callback([o, &exit_code] {
    try {
      exit_code = run(*o);
    } catch (const Stopped&) {
      fmt::print(stderr, "twinrate: response interrupted, nothing written\n");
      exit_code = 1;
    }
  });
}

}  // namespace twinrate

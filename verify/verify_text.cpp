// verify.json and the table on the terminal.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "verify/verify.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kSimulated = "closed loop";

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}
Json json(const BeforeAfter& pair) {
  return {{"before", number(pair.before)}, {"after", number(pair.after)}};
}
Json json(const std::optional<ModelError>& e) {
  if (!e) return nullptr;
  return {{"runs", e->runs},
          {"i_d_rms_A", json(e->i_d)},
          {"i_q_rms_A", json(e->i_q)},
          {"omega_m_rms_rad_s", json(e->omega_m)}};
}

// A line of the table.
struct Compared {
  std::string level, what;
  const char* unit;
  BeforeAfter error;
  double ratio() const { return error.before > 0 ? error.after / error.before : 1; }
};

std::vector<Compared> compared(const Verification& v) {
  std::vector<Compared> all;
  const auto model = [&](const char* level, const std::string& currents, const std::string& speed,
                         const std::optional<ModelError>& e) {
    if (!e) return;
    all.push_back({level, "i_d " + currents, "A", e->i_d});
    all.push_back({level, "i_q " + currents, "A", e->i_q});
    all.push_back({level, "omega_m " + speed, "rad/s", e->omega_m});
  };
  const std::string window = fmt::format("over {:g} s", v.window_s);
  model("one step", "over one sample", fmt::format("over {:g} ms", 1e3 * v.speed_horizon_s),
        v.one_step);
  model("free run", window, window, v.free_run);
  if (v.estimator) {
    const char* level = v.estimator->over_lcm ? "over LCM" : "estimator";
    for (std::size_t i = 0; i < v.estimator->innovation.size(); ++i)
      all.push_back({level, fmt::format("innovation {}", i + 1), "", v.estimator->innovation[i]});
    if (v.estimator->theta_e)
      all.push_back({level, "theta_e against measured", "rad", *v.estimator->theta_e});
  }
  if (v.closed_loop) {
    all.push_back({kSimulated, "theta_e", "rad", v.closed_loop->theta_e});
    all.push_back({kSimulated, "speed ripple", "rad/s", v.closed_loop->speed_ripple});
    if (v.closed_loop->has_load)
      all.push_back({kSimulated, "load estimate", "Nm", v.closed_loop->T_load});
  }
  return all;
}

}  // namespace

std::string to_json(const Verification& v) {
  Json all;
  all["speed_horizon_s"] = v.speed_horizon_s;
  all["window_s"] = v.window_s;
  all["one_step_prediction"] = json(v.one_step);
  all["free_run"] = json(v.free_run);
  all["estimator"] = nullptr;
  if (v.estimator) {
    Json innovation = Json::array();
    for (const BeforeAfter& pair : v.estimator->innovation) innovation.push_back(json(pair));
    all["estimator"] = {{"over", v.estimator->over_lcm ? "lcm" : "in_process"},
                        {"ticks", v.estimator->ticks},
                        {"different_from_in_process", v.estimator->different},
                        {"sent_again", v.estimator->repeats},
                        {"innovation_rms", innovation},
                        {"angle_error_rms_rad",
                         v.estimator->theta_e ? json(*v.estimator->theta_e) : Json(nullptr)}};
  }
  all["closed_loop"] = nullptr;
  if (v.closed_loop)
    all["closed_loop"] = {{"duration_s", v.closed_loop->duration_s},
                          {"angle_error_rms_rad", json(v.closed_loop->theta_e)},
                          {"speed_ripple_rms_rad_s", json(v.closed_loop->speed_ripple)},
                          {"load_error_rms_Nm",
                           v.closed_loop->has_load ? json(v.closed_loop->T_load) : Json(nullptr)}};
  all["remarks"] = remarks(v);
  all["notes"] = v.notes;
  return all.dump(2) + "\n";
}

std::vector<std::string> remarks(const Verification& v) {
  // An rms of 200 independent errors scatters by 5 %; both models have the same noise.
  constexpr double kWorseFrom = 0.05;   // relative rise of an error that is reported
  constexpr double kEqualBelow = 5e-4;  // relative change that is printed as x 1.000
  const std::vector<Compared> all = compared(v);
  std::vector<std::string> worse, nothing;
  for (const Compared& f : all)
    if (f.ratio() > 1 + kWorseFrom)
      worse.push_back(fmt::format("{} {} x {:.3f}", f.level, f.what, f.ratio()));
  for (std::size_t first = 0, end = 0; first < all.size(); first = end) {
    while (end < all.size() && all[end].level == all[first].level) ++end;
    if (std::all_of(all.begin() + static_cast<std::ptrdiff_t>(first),
                    all.begin() + static_cast<std::ptrdiff_t>(end),
                    [](const Compared& f) { return std::abs(f.ratio() - 1) < kEqualBelow; }))
      nothing.push_back(all[first].level);
  }
  std::vector<std::string> lines;
  if (!worse.empty())
    lines.push_back(fmt::format("worse with the extended model: {}", fmt::join(worse, ", ")));
  if (!nothing.empty())
    lines.push_back(
        fmt::format("no change with the extended model (x 1.000): {}", fmt::join(nothing, ", ")));
  return lines;
}

std::string table(const Verification& v) {
  std::string text =
      fmt::format("  {:<12} {:<28} {:>11} {:>11}\n", "level", "error, rms", "declared", "extended");
  std::string level;
  for (const Compared& f : compared(v)) {
    if (f.level == kSimulated && f.level != level)
      text += "  simulated, no held-out data: the extended model is the plant\n";
    text += fmt::format("  {:<12} {:<28} {:>11.4g} {:>11.4g}  {:<6} {:>7}\n",
                        f.level == level ? "" : f.level, f.what, f.error.before, f.error.after,
                        f.unit, f.error.before > 0 ? fmt::format("x {:.3f}", f.ratio()) : "");
    level = f.level;
  }
  if (v.estimator && v.estimator->different > 0)
    text += fmt::format("  {} estimates over LCM differ from those in one process\n",
                        v.estimator->different);
  for (const std::string& line : remarks(v)) text += "  " + line + "\n";
  for (const std::string& note : v.notes) text += "  " + note + "\n";
  return text;
}

}  // namespace twinrate

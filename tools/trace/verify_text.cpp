// verify.json and the table on the terminal.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/trace/verify.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

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

std::string row(const char* level, const std::string& what, const char* unit,
                const BeforeAfter& pair) {
  return fmt::format("  {:<12} {:<28} {:>11.4g} {:>11.4g}  {:<6} {:>7}\n", level, what, pair.before,
                     pair.after, unit,
                     pair.before > 0 ? fmt::format("x {:.3f}", pair.after / pair.before) : "");
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
  all["notes"] = v.notes;
  return all.dump(2) + "\n";
}

std::string table(const Verification& v) {
  std::string text =
      fmt::format("  {:<12} {:<28} {:>11} {:>11}\n", "level", "error, rms", "declared", "extended");
  const auto model_rows = [&](const char* level, const std::string& currents,
                              const std::string& speed, const std::optional<ModelError>& e) {
    if (!e) return;
    text += row(level, "i_d " + currents, "A", e->i_d) + row("", "i_q " + currents, "A", e->i_q) +
            row("", "omega_m " + speed, "rad/s", e->omega_m);
  };
  model_rows("one step", "over one sample", fmt::format("over {:g} ms", 1e3 * v.speed_horizon_s),
             v.one_step);
  model_rows("free run", fmt::format("over {:g} s", v.window_s),
             fmt::format("over {:g} s", v.window_s), v.free_run);
  if (v.estimator) {
    const char* level = v.estimator->over_lcm ? "over LCM" : "estimator";
    for (std::size_t i = 0; i < v.estimator->innovation.size(); ++i)
      text += row(i == 0 ? level : "", fmt::format("innovation {}", i + 1), "",
                  v.estimator->innovation[i]);
    if (v.estimator->theta_e)
      text += row("", "theta_e against measured", "rad", *v.estimator->theta_e);
    if (v.estimator->different > 0)
      text += fmt::format("  {} estimates over LCM differ from those in one process\n",
                          v.estimator->different);
  }
  if (v.closed_loop) {
    text += row("closed loop", "theta_e", "rad", v.closed_loop->theta_e);
    text += row("", "speed ripple", "rad/s", v.closed_loop->speed_ripple);
    if (v.closed_loop->has_load) text += row("", "load estimate", "Nm", v.closed_loop->T_load);
  }
  for (const std::string& note : v.notes) text += "  " + note + "\n";
  return text;
}

}  // namespace twinrate

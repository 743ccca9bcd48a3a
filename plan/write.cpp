#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "loop/load_drive.hpp"
#include "plan/plan.hpp"
#include "report/svg.hpp"

namespace twinrate {
namespace {

using json = nlohmann::ordered_json;
constexpr double kRpm = 60 / kTwoPi, kDegree = 360 / kTwoPi;

double degrees(const KindOutlook& k) {
  return kDegree * std::asin(std::clamp(k.sine[k.nearest], 0.0, 1.0));
}

std::string sigmas_text(double sigmas) {
  return sigmas > 999 ? ">999" : fmt::format("{:.3g}", sigmas);
}

json to_json(const KindOutlook& k, const std::vector<std::string>& kinds, std::size_t own) {
  json out{{"identifiable", k.identifiable()}, {"sigmas", k.alone}};
  if (k.nearest != own)
    out["nearest"] = {{"kind", kinds[k.nearest]},
                      {"sigmas", k.beside[k.nearest]},
                      {"angle_deg", degrees(k)},
                      {"separated", k.separated()}};
  return out;
}

json steps_json(const std::vector<ProfileStep>& steps, double factor) {
  json list = json::array();
  for (const ProfileStep& step : steps) list.push_back({step.t_s, factor * step.value});
  return list;
}

// A reference behind its slew limit, for the figure.
gallery::Curve curve(const std::vector<ProfileStep>& steps, double slew_limit, double duration_s,
                     double factor) {
  constexpr int kPoints = 2000;
  gallery::Curve c{.name = "", .colour = "#1f6feb", .x = {}, .y = {}};
  const Profile profile(steps);
  double now = 0, slope = 0;
  const double dt = duration_s / kPoints;
  for (int j = 0; j <= kPoints; ++j) {
    const double before = now;
    now = slew(now, profile.at(j * dt), slew_limit, dt);
    const bool straight = j > 1 && std::abs(now - before - slope) < 1e-9 * (1 + std::abs(now));
    slope = now - before;
    if (!straight) {
      c.x.push_back(0);
      c.y.push_back(0);
    }
    c.x.back() = j * dt;
    c.y.back() = factor * now;
  }
  return c;
}

}  // namespace

std::string plan_toml(const Config& drive, const Plan& plan) {
  std::string head = "# " + plan.sentence + "\n# blocks:";
  for (std::size_t j = 0; j < plan.order.size(); ++j)
    head += fmt::format("\n#   {:6.2f} s  {}: {}", plan.profile.start_s[j],
                        plan.blocks[plan.order[j]].name, plan.blocks[plan.order[j]].words);
  Config with = Config::parse(drive.resolved(), drive.drive().name, plan.overrides);
  read_all_tables(with);
  return head + "\n\n" + with.resolved();
}

static json kinds_json(const Plan& plan) {
  json kinds = json::array();
  for (std::size_t a = 0; a < plan.kinds.size(); ++a) {
    json kind{{"kind", plan.kinds[a]}};
    if (!plan.log.empty()) kind["log"] = to_json(plan.log[a], plan.kinds, a);
    kind["after"] = to_json(plan.after[a], plan.kinds, a);
    kinds.push_back(std::move(kind));
  }
  return kinds;
}

static json blocks_json(const Plan& plan) {
  json blocks = json::array();
  for (std::size_t j = 0; j < plan.order.size(); ++j) {
    const PlanBlock& b = plan.blocks[plan.order[j]];
    blocks.push_back({{"name", b.name},
                      {"does", b.words},
                      {"start_s", plan.profile.start_s[j]},
                      {"duration_s", b.duration_s}});
  }
  return blocks;
}

static json never_json(const Plan& plan) {
  json never = json::array();
  for (const NotSeparated& n : plan.never) {
    json pair{{"kind", n.a}};
    if (!n.b.empty()) pair["other"] = n.b;
    pair["why"] = n.why;
    never.push_back(std::move(pair));
  }
  return never;
}

static json outside_json(const Plan& plan) {
  json outside = json::array();
  for (const OutsideKind& k : plan.outside) {
    json kind{{"kind", k.kind}, {"needs", k.needs}, {"in_run", k.in_run}};
    if (!k.shown_by.empty()) kind["blocks"] = k.shown_by;
    if (!k.log.empty()) kind["log"] = k.log;
    outside.push_back(std::move(kind));
  }
  return outside;
}

std::string plan_json(const Plan& plan) {
  const json out{{"sentence", plan.sentence},
                 {"duration_s", plan.profile.duration_s},
                 {"checked_by_simulation", plan.checked},
                 {"bench",
                  {{"speed_max_rpm", kRpm * plan.bench.omega_m_max},
                   {"i_max_A", plan.bench.i_max},
                   {"T_load_max_Nm", plan.bench.T_load_max},
                   {"reverses", plan.bench.reverse}}},
                 {"notes", plan.notes},
                 {"blocks", blocks_json(plan)},
                 {"kinds", kinds_json(plan)},
                 {"outside_the_design", outside_json(plan)},
                 {"no_run_of_this_bench", never_json(plan)},

                 {"profile",
                  {{"speed_rpm", steps_json(plan.profile.omega_m, kRpm)},
                   {"T_load_Nm", steps_json(plan.profile.T_load, 1)},
                   {"i_d_A", steps_json(plan.profile.i_d, 1)}}}};
  return out.dump(1) + "\n";
}

std::string plan_svg(const Plan& plan) {
  const PlanProfile& p = plan.profile;
  const Bench& b = plan.bench;
  std::vector<gallery::Panel> panels(3);
  panels[0] = {.title = "speed reference, rpm",
               .x_label = "time, s",
               .curves = {curve(p.omega_m, b.slew, p.duration_s, kRpm)}};
  panels[1] = {.title = "load, Nm",
               .x_label = "time, s",
               .curves = {curve(p.T_load, b.load_slew, p.duration_s, 1)}};
  if (b.T_load_max == 0) panels[1].empty_note = "no load machine";
  panels[2] = {.title = "i_d reference, A",
               .x_label = "time, s",
               .curves = {curve(p.i_d, 0, p.duration_s, 1)}};
  std::vector<gallery::Line> lines;
  for (std::size_t a = 0; a < plan.kinds.size(); ++a) {
    const KindOutlook& k = plan.after[a];
    lines.push_back(
        {plan.kinds[a],
         k.nearest == a ? sigmas_text(k.alone)
                        : fmt::format("{} beside {} ({:.0f} deg)", sigmas_text(k.beside[k.nearest]),
                                      plan.kinds[k.nearest], degrees(k)),
         std::min(1.0, k.clear[k.nearest] / (5 * kEnoughSigmas))});
  }
  return gallery::svg(fmt::format("A run of {:.4g} s", p.duration_s), panels,
                      "sigmas of the smallest size worth reporting that no other kind imitates "
                      "(a fifth of the bar is enough)",
                      lines);
}

std::string plan_table(const Plan& plan) {
  const bool with_log = !plan.log.empty();
  const auto seen = [&](const KindOutlook& k) {
    return fmt::format("{:>6} {:<3}", sigmas_text(k.alone), k.identifiable() ? "yes" : "no");
  };
  const auto in_log = [&](const KindOutlook& k, std::size_t own) {
    const bool alias = k.nearest != own && k.identifiable() && !k.separated();
    return fmt::format("{} {:<22}", seen(k), alias ? "or " + plan.kinds[k.nearest] : "");
  };
  const auto beside = [&](const KindOutlook& k, std::size_t own) {
    if (k.nearest == own || k.alone == 0) return std::string("-");
    return fmt::format("{:<20} {:>6} sigmas {:>3.0f} deg  {}", plan.kinds[k.nearest],
                       sigmas_text(k.beside[k.nearest]), degrees(k),
                       k.separated() ? "apart" : "NOT apart");
  };
  std::string text = fmt::format("  {:<21}{}{:<12}{}\n", "kind",
                                 with_log ? fmt::format("{:<33}", "seen in the log") : "",
                                 "in the run", "nearest other kind");
  for (std::size_t a = 0; a < plan.kinds.size(); ++a)
    text += fmt::format("  {:<20}{}{}  {}\n", plan.kinds[a], with_log ? in_log(plan.log[a], a) : "",
                        seen(plan.after[a]), beside(plan.after[a], a));
  text += "  (sigmas of the smallest size worth reporting; 4 are enough)\n";
  if (!plan.never.empty()) text += "no run of this bench:\n";
  for (const NotSeparated& n : plan.never)
    text += n.b.empty() ? fmt::format("  shows {}: {}\n", n.a, n.why)
                        : fmt::format("  separates {} from {}: {}\n", n.a, n.b, n.why);
  if (!plan.outside.empty()) text += "not in the information matrix:\n";
  for (const OutsideKind& k : plan.outside)
    text += fmt::format("  {:<20}{:<4} {}{}\n", k.kind, k.in_run ? "yes" : "no", k.needs,
                        k.log.empty() ? "" : fmt::format("; the log: {}", k.log));
  for (const std::string& note : plan.notes) text += "note: " + note + "\n";
  if (!plan.order.empty()) text += "the run:\n";
  for (std::size_t j = 0; j < plan.order.size(); ++j)
    text += fmt::format("  {:6.2f} s  {:<18} {}\n", plan.profile.start_s[j],
                        plan.blocks[plan.order[j]].name, plan.blocks[plan.order[j]].words);
  return text;
}

}  // namespace twinrate

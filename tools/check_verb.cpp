// twinrate check DRIVE.toml: validates a drive file and compares its demands with the machine.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <optional>

#include "controller/controller.hpp"
#include "core/field_list.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/registry.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct CheckOptions {
  std::string drive;
  std::vector<std::string> overrides;
  bool resolved = false, reference = false;
};

double largest(const Profile& profile) {
  double amplitude = 0;
  for (const ProfileStep& step : profile.steps())
    amplitude = std::max(amplitude, std::abs(step.value));
  return amplitude;
}

// What the drive is asked for, against what it has. All electrical speeds in rad/s, peak phase
// values.
struct Demand {
  double omega_e = 0, emf = 0, u_needed = 0, u_max = 0, T_load = 0, i_q = 0;
  std::optional<double> i_max;
};

std::optional<double> current_limit(Config& config) {
  const std::string kind = config.drive().controller.kind;
  const auto builder = controller_builder(kind);
  const auto fields = [&](FieldVisitor& f) { builder->fields(f); };
  config.read_table("controller." + kind, fields);
  for (const FieldRow& row : list_fields(fields))
    if (row.key == "i_max_A") return row.value;
  return {};
}

Demand demand_of(Config& config) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  Demand demand;
  demand.omega_e = d.reference.in_rpm ? largest(d.reference.speed_rpm) * kTwoPi / 60 * m.n_p
                                      : largest(d.reference.omega_e_rad_s);
  demand.u_max = d.inverter.u_max_linear();
  demand.emf = demand.omega_e * m.psi_f;
  demand.T_load = largest(d.load.T_load_Nm);
  demand.i_q = (demand.T_load + m.B * demand.omega_e / m.n_p) / m.torque_constant();
  demand.u_needed =
      std::hypot(demand.omega_e * m.L_q * demand.i_q, demand.emf + m.R_s * demand.i_q);
  demand.i_max = current_limit(config);
  return demand;
}

std::vector<std::string> warnings_of(const Config& config, const Demand& demand) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  std::vector<std::string> list;
  const std::string speed_key =
      d.reference.in_rpm ? "reference.speed_rpm" : "reference.omega_e_rad_s";
  const auto warn = [&](const std::string& key, const std::string& what) {
    list.push_back(fmt::format("{}: {}: {}", config.where(key), key, what));
  };
  if (demand.u_needed > demand.u_max)
    warn(speed_key, fmt::format("needs {:.4g} V, v_dc allows {:.4g} V; without load this allows "
                                "{:.4g} rad/s electrical",
                                demand.u_needed, demand.u_max, demand.u_max / m.psi_f));
  if (demand.i_max && demand.i_q > *demand.i_max)
    warn("load.T_load_Nm",
         fmt::format("needs i_q = {:.4g} A, i_max_A is {:.4g} A", demand.i_q, *demand.i_max));
  if (m.omega_m_rated > 0 && demand.omega_e > m.n_p * m.omega_m_rated)
    warn(speed_key,
         fmt::format("above the rated speed, {:.4g} rad/s electrical", m.n_p * m.omega_m_rated));
  const double samples = d.rates.f_s_Hz / (demand.omega_e / kTwoPi);
  if (samples < 10)
    warn("rates.f_s_Hz",
         fmt::format("only {:.3g} samples an electrical turn at the reference speed", samples));
  const bool turned = is_made_for_use(d.gain.policy) || !has_background(d.gain.policy);
  if (d.estimator.kind == "ekf_sensorless" && !turned && samples / d.rates.n < 7)
    warn("rates.n",
         fmt::format("only {:.3g} gain updates an electrical turn at the reference speed; "
                     "below about 7 a held gain loses synchronism",
                     samples / d.rates.n));
  const double decay = d.T_s() * m.R_s / std::min(m.L_d, m.L_q);
  if (d.estimator.prediction == Prediction::kEuler && decay > 1)
    warn("estimator.prediction",
         fmt::format("Euler on currents: R_s/(L f_s) = {:.3g} {}, use exact or rk4", decay,
                     decay > 2 ? "is unstable" : "overshoots"));
  return list;
}

void print_summary(Config& config) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  const Demand demand = demand_of(config);
  fmt::print("{}\n", d.name.empty() ? "(no name)" : d.name);
  fmt::print(
      "  machine     {} pole pairs, R_s {} Ohm, L_d {:.4g} mH, L_q {:.4g} mH, psi_f {:.4g} mWb, J "
      "{:.4g} kgm2, K_t {:.4g} Nm/A\n",
      m.n_p, m.R_s, 1e3 * m.L_d, 1e3 * m.L_q, 1e3 * m.psi_f, m.J, m.torque_constant());
  fmt::print("  rates       f_s {} Hz, f_b {:.6g} Hz (n = {}), gain policy {}\n", d.rates.f_s_Hz,
             d.rates.f_b_Hz, d.rates.n, kGainPolicyNames[static_cast<int>(d.gain.policy)]);
  fmt::print("  estimator   {}\n  controller  {}, angle from {}, start {}\n", d.estimator.kind,
             d.controller.kind, kAngleSourceNames[static_cast<int>(d.controller.angle_source)],
             kStartNames[static_cast<int>(d.start)]);
  fmt::print("  limits      {} V bus: {:.4g} V a phase", d.inverter.v_dc, demand.u_max);
  if (demand.i_max)
    fmt::print("; {} A: {:.4g} Nm", *demand.i_max, *demand.i_max * m.torque_constant());
  fmt::print(
      "\n  reference   {:.5g} rad/s electrical ({:.5g} Hz, {:.5g} rpm), EMF {:.4g} V = {:.3g} % of "
      "the voltage limit\n",
      demand.omega_e, demand.omega_e / kTwoPi, demand.omega_e / m.n_p * 60 / kTwoPi, demand.emf,
      100 * demand.emf / demand.u_max);
  fmt::print("  load        {:.4g} Nm: i_q {:.4g} A\n", demand.T_load, demand.i_q);
  fmt::print("  run         {} s = {} ticks, figures from {} s, seed {}\n", d.run.duration_s,
             d.steps(), d.run.settle_s, d.run.seed);
  for (const auto& [effect, used_in, from_s] : d.effects)
    fmt::print("  effect      {} ({}{})\n", effect->kind(), kUsedInNames[static_cast<int>(used_in)],
               from_s > 0 ? fmt::format(", from {:g} s", from_s) : "");
  const auto warnings = warnings_of(config, demand);
  for (const std::string& warning : warnings) fmt::print("warning: {}\n", warning);
  fmt::print("{}\n", warnings.empty() ? "ok"
                                      : fmt::format("ok, {} warning{}", warnings.size(),
                                                    warnings.size() == 1 ? "" : "s"));
}

void print_rows(const std::string& title, const std::string& intro,
                const std::vector<KeyRow>& rows) {
  fmt::print("\n## {}\n\n{}| key | allowed | default | meaning |\n|---|---|---|---|\n", title,
             intro.empty() ? "" : intro + "\n\n");
  for (const KeyRow& row : rows)
    fmt::print("| `{}` | {} | {} | {} |\n", row.key, row.range,
               row.default_value.empty() ? "required" : "`" + row.default_value + "`", row.meaning);
}

template <class Kinds, class MakeBuilder>
void print_kinds(const std::string& owner, const Kinds& kinds, MakeBuilder make_builder) {
  for (const std::string& kind : kinds) {
    const auto builder = make_builder(kind);
    const std::string path = owner + "." + kind;
    print_rows("[" + path + "]", fmt::format("Read where `{}.kind = \"{}\"`.", owner, kind),
               describe_keys(path, [&](FieldVisitor& f) { builder->fields(f); }));
  }
}

// The page docs/config-reference.md.
void print_reference() {
  fmt::print(
      "# Every key of a drive file\n\nWritten by `twinrate check --reference`; do not edit. A key "
      "left out has "
      "its default. Unknown keys are errors.\n`--set key.path=value` overrides one key on the "
      "command line.\n");
  std::vector<KeyRow> section;
  const auto table_of = [](const KeyRow& row) {
    const auto dot = row.key.rfind('.');
    return dot == std::string::npos ? std::string() : row.key.substr(0, dot);
  };
  const std::vector<KeyRow> rows = describe_drive_keys(owned_tables());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    section.push_back(rows[i]);
    if (section.back().key == "preset") section.back().default_value = "none";
    if (i + 1 < rows.size() && table_of(rows[i + 1]) == table_of(rows[i])) continue;
    const std::string table = table_of(rows[i]);
    print_rows(table.empty() ? "Top level" : "[" + table + "]", "", section);
    section.clear();
  }
  print_kinds("estimator", filter_kinds(), filter_builder);
  print_kinds("controller", controller_kinds(), controller_builder);
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    print_rows(fmt::format("[[effect]] kind = \"{}\"", kind), fmt::format("{}.", effect->meaning()),
               describe_keys("effect", [&](FieldVisitor& f) { effect->fields(f); }));
  }
}

void check(const CheckOptions& options) {
  if (options.reference) return print_reference();
  if (options.drive.empty())
    throw BadInput("check: a drive file or the name of a preset is required");
  Config config = load_drive(options.drive, options.overrides);
  make_fast_loop(config, false);  // refuses a gain policy that the filter cannot run
  if (options.resolved)
    std::cout << config.resolved();
  else
    print_summary(config);
}

}  // namespace

void add_check_verb(CLI::App& app, int&) {
  auto options = std::make_shared<CheckOptions>();
  auto* verb = app.add_subcommand("check", "Validate a drive file and print its operating point");
  verb->add_option("drive", options->drive, "read this drive file or preset");
  verb->add_option("--set", options->overrides,
                   "override a key of the drive file: key.path=value; repeat for more keys")
      ->allow_extra_args(false)
      ->take_all();
  verb->add_flag("--resolved", options->resolved,
                 "print the whole config with every default, as TOML");
  verb->add_flag("--reference", options->reference,
                 "print the reference page of every key, as Markdown");
  verb->callback([options] { check(*options); });
}

}  // namespace twinrate

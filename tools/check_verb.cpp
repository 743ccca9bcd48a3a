// twinrate check DRIVE.toml: validates a drive file and compares its demands with the machine.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "controller/controller.hpp"
#include "core/field_list.hpp"
#include "estimator/registry.hpp"
#include "loop/demand.hpp"
#include "loop/drive_schema.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "loop/trial_run.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct CheckOptions {
  std::string drive;
  std::vector<std::string> overrides;
  bool resolved = false, reference = false, schema = false, json = false;
};

void print_summary(Config& config, const std::vector<std::string>& warnings,
                   const std::vector<std::string>& notes) {
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
  if (demand.i_max) fmt::print("; {:.4g} A: {:.4g} Nm", *demand.i_max, *demand.T_max);
  fmt::print(
      "\n  reference   {:.5g} rad/s electrical ({:.5g} Hz, {:.5g} rpm), EMF {:.4g} V = {:.3g} % of "
      "the voltage limit\n",
      demand.omega_e, demand.omega_e / kTwoPi, demand.omega_e / m.n_p * 60 / kTwoPi, demand.emf,
      100 * demand.emf / demand.u_max);
  fmt::print("  load        {:.4g} Nm: ", demand.T_load);
  if (demand.at_mtpa) fmt::print("i_d {:.4g} A, ", demand.i_dq[0]);
  fmt::print("i_q {:.4g} A\n", demand.i_dq[1]);
  const double hand_over_s = start_takes_s(config);
  const std::string window = hand_over_s > d.run.settle_s
                                 ? fmt::format("the hand-over on (about {:.3g} s)", hand_over_s)
                                 : fmt::format("{} s", d.run.settle_s);
  fmt::print("  run         {} s = {} ticks, figures from {}, seed {}\n", d.run.duration_s,
             d.steps(), window, d.run.seed);
  for (const auto& [effect, used_in, from_s, known_from_s, known_to_s] : d.effects)
    fmt::print("  effect      {} ({}{}{}{})\n", effect->kind(),
               kUsedInNames[static_cast<int>(used_in)],
               from_s > 0 ? fmt::format(", from {:g} s", from_s) : "",
               known_from_s > 0 ? fmt::format(", known from {:g} s", known_from_s) : "",
               std::isfinite(known_to_s) ? fmt::format(", known to {:g} s", known_to_s) : "");
  for (const std::string& note : notes) fmt::print("note: {}\n", note);
  for (const std::string& warning : warnings) fmt::print("warning: {}\n", warning);
  fmt::print("{}\n", warnings.empty() ? "ok"
                                      : fmt::format("ok, {} warning{}", warnings.size(),
                                                    warnings.size() == 1 ? "" : "s"));
}

void print_json(Config& config, const std::vector<std::string>& warnings,
                const std::vector<std::string>& notes) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  const Demand demand = demand_of(config);
  nlohmann::ordered_json json = {{"name", d.name},
                                 {"ok", true},
                                 {"warnings", warnings},
                                 {"notes", notes},
                                 {"machine",
                                  {{"n_p", m.n_p},
                                   {"R_s_Ohm", m.R_s},
                                   {"L_d_H", m.L_d},
                                   {"L_q_H", m.L_q},
                                   {"psi_f_Wb", m.psi_f},
                                   {"J_kgm2", m.J},
                                   {"torque_constant_Nm_A", m.torque_constant()}}},
                                 {"f_s_Hz", d.rates.f_s_Hz},
                                 {"f_b_Hz", d.rates.f_b_Hz},
                                 {"n", d.rates.n},
                                 {"u_max_V", demand.u_max},
                                 {"i_max_A", nullptr},
                                 {"T_max_Nm", nullptr},
                                 {"omega_e_rad_s", demand.omega_e},
                                 {"emf_V", demand.emf},
                                 {"T_load_Nm", demand.T_load},
                                 {"i_d_A", demand.i_dq[0]},
                                 {"i_q_A", demand.i_dq[1]}};
  if (demand.i_max) json["i_max_A"] = *demand.i_max, json["T_max_Nm"] = *demand.T_max;
  std::cout << json.dump() << "\n";
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
    const std::string path = fmt::format("{}.{}", owner, kind);
    std::vector<KeyRow> rows = describe_keys(path, [&](FieldVisitor& f) { builder->fields(f); });
    for (KeyRow& row : rows)  // required of a builder without a drive alone
      if (row.key.ends_with(".i_max_A")) row.default_value = "1.5 machine.i_rated_A";
    print_rows(
        "[" + path + "]",
        fmt::format("Read where `{}.kind = \"{}\"`. Defaults in physical units scale with the "
                    "machine of the drive file (`check --resolved` prints them).",
                    owner, kind),
        rows);
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
  print_kinds("estimator", filter_kinds(),
              [](const std::string& kind) { return filter_builder(kind); });
  print_kinds("controller", controller_kinds(),
              [](const std::string& kind) { return controller_builder(kind); });
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    print_rows(fmt::format("[[effect]] kind = \"{}\"", kind), fmt::format("{}.", effect->meaning()),
               describe_keys("effect", [&](FieldVisitor& f) { effect->fields(f); }));
  }
}

void check(const CheckOptions& options) {
  if (options.json && (options.reference || options.schema || options.resolved))
    throw BadInput("check: --json: not allowed with --resolved, --reference or --schema");
  if (options.reference) return print_reference();
  if (options.schema) {
    std::cout << drive_schema();
    return;
  }
  if (options.drive.empty())
    throw BadInput("check: a drive file or the name of a preset is required");
  Config config = load_drive(options.drive, options.overrides);
  std::vector<std::string> notes;
  const std::vector<std::string> warnings = check_by_trial(config, Trial::kAlways, &notes);
  if (options.resolved)
    std::cout << config.resolved();
  else if (options.json)
    print_json(config, warnings, notes);
  else
    print_summary(config, warnings, notes);
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
  verb->add_flag("--schema", options->schema, "print the JSON Schema of drive files");
  verb->add_flag("--json", options->json, "print the operating point and the warnings as JSON");
  verb->callback([options] { check(*options); });
}

}  // namespace twinrate

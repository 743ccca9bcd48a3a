// twinrate effects list [--json]: all effects, their parameters with units and ranges, and the
// signals that they need.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "core/field_list.hpp"
#include "model/effects/tracing.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kSigns =
    "theta_e = n_p theta_m, d axis at theta_m = 0. Torques add to T_load, which opposes positive "
    "omega_m; voltages subtract from the applied phase voltage in rotor axes. Measured current = "
    "(1 + gain) true + offset.";

// The equations and readings that an effect changes.
std::string acts_on(const Effect& effect) {
  constexpr std::pair<int, const char*> kNames[] = {
      {kOnTorque, "T_load"},          {kOnVoltage, "u_dq"},          {kOnBus, "v_dc"},
      {kOnCurrents, "i_abc reading"}, {kOnAngle, "theta_m reading"}, {kOnFlux, "psi_dq"},
      {kOnSpeed, "omega_m reading"}};
  std::string list;
  for (const auto& [bit, name] : kNames)
    if (effect.acts_on() & bit) list += (list.empty() ? "" : ", ") + std::string(name);
  return list.empty() ? "whole rows" : list;
}

Json parameter_json(const FieldRow& row) {
  const NameAndUnit split = split_unit(row.key);
  Json parameter = {{"key", row.key},   {"name", split.name},       {"unit", split.unit},
                    {"type", row.type}, {"required", row.required}, {"meaning", row.meaning}};
  if (row.lo != row.hi) parameter["range"] = {row.lo, row.hi};
  if (!row.choices.empty()) parameter["choices"] = row.choices;
  if (!row.required) parameter["default"] = row.value_text;
  return parameter;
}

void print_json() {
  Json effects = Json::array();
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    Json parameters = Json::array();
    for (const FieldRow& row : list_fields([&](FieldVisitor& f) { effect->fields(f); }))
      parameters.push_back(parameter_json(row));
    effects.push_back({{"kind", kind},
                       {"meaning", effect->meaning()},
                       {"acts_on", acts_on(*effect)},
                       {"signals_needed", effect->tracing().signals_needed()},
                       {"parameters", parameters}});
  }
  std::cout << Json{{"signs", kSigns}, {"effects", effects}}.dump(2) << "\n";
}

std::string range_text(const FieldRow& row) {
  if (!row.choices.empty()) return fmt::format("{}", fmt::join(row.choices, ", "));
  return row.lo != row.hi ? fmt::format("{:g} to {:g}", row.lo, row.hi) : row.type;
}

void print_text() {
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    fmt::print("{}: {}\n  acts on {}; to trace it a log needs {}\n", kind, effect->meaning(),
               acts_on(*effect), fmt::join(effect->tracing().signals_needed(), ", "));
    for (const FieldRow& row : list_fields([&](FieldVisitor& f) { effect->fields(f); }))
      fmt::print("  {:<16} {:<8} {:<18} {:<10} {}\n", row.key, "[" + split_unit(row.key).unit + "]",
                 range_text(row), row.required ? "required" : "= " + row.value_text, row.meaning);
    fmt::print("\n");
  }
  fmt::print("Signs: {}\n", kSigns);
}

}  // namespace

void add_effects_verb(CLI::App& app, int&) {
  auto* effects =
      app.add_subcommand("effects", "List the effects that a drive file can add to the equations");
  effects->require_subcommand(1);
  auto* list = effects->add_subcommand(
      "list", "List kinds, parameters with units, and the signals that a trace needs");
  auto as_json = std::make_shared<bool>(false);
  list->add_flag("--json", *as_json, "print JSON instead of text");
  list->callback([as_json] { *as_json ? print_json() : print_text(); });
}

}  // namespace twinrate

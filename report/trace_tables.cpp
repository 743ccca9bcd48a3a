// The tables of the page of a trace.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "report/trace_parts.hpp"

namespace twinrate::report {
namespace {

std::string percent(double share) {
  return std::isfinite(share) ? fmt::format("{:.1f} %", 100 * share) : "-";
}

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "-";
}

// Without a line break in the page.
std::string p_value(double p) {
  if (!std::isfinite(p)) return "-";
  std::string text = p < 1e-300 ? "<1e-300" : fmt::format("{:.2g}", p);
  if (const auto minus = text.find('-'); minus != std::string::npos)
    text.replace(minus, 1, "\u2011");
  return text;
}

std::string spaced(std::string kind) {
  std::replace(kind.begin(), kind.end(), '_', ' ');
  return kind;
}

// The unit of a key's suffix.
std::string unit_words(const std::string& suffix) {
  static const std::map<std::string, std::string> kWords = {
      {"1", ""},          {"per_rev", "a turn"}, {"Nm_rad", "Nm/rad"}, {"Nms_rad", "Nms/rad"},
      {"rad_s", "rad/s"}, {"kgm2", "kg m2"},     {"H_A", "H/A"},       {"H_A2", "H/A2"},
      {"Nms2", "Nm s2"}};
  const auto found = kWords.find(suffix);
  return found == kWords.end() ? suffix : found->second;
}

Json row_of(const TracedEffect& e) {
  const std::string aliases = e.aliases.empty()
                                  ? (std::isfinite(e.delta_bic) || e.from_samples ? "none" : "-")
                                  : fmt::format("{}", fmt::join(e.aliases, ", "));
  const std::string kind(e.effect->kind());
  if (e.from_samples)
    return {kind,
            e.equation,
            parameters_text(e),
            "found in the raw samples",
            "",
            "",
            fmt::format("{:.3g}", e.materiality),
            aliases};
  return {kind,
          e.equation,
          parameters_text(e),
          std::isfinite(e.delta_bic) ? fmt::format("{:.0f}", e.delta_bic) : "not judged",
          percent(e.held_out_gain),
          p_value(e.p_value),
          fmt::format("{:.3g}", e.materiality),
          aliases};
}

Json section(const std::string& heading, const std::string& note, Json table) {
  return {{"heading", heading},
          {"note", note},
          {"columns", 1},
          {"figures", Json::array()},
          {"table", std::move(table)}};
}

Json considered_section(const TraceResult& r) {
  Json rows = Json::array();
  for (const Rejected& x : r.rejected)
    rows.push_back({x.kind, x.why, fmt::format("{:.0f}", -x.score_gain),
                    std::isfinite(x.held_out_gain) ? percent(x.held_out_gain) : "-"});
  return section(
      "Alternatives considered",
      "Candidates with a held-out gain were fitted fully. For the others (-) the BIC is an "
      "estimate from the fitted rows. A change of BIC above 0, or a held-out gain of 0 or less, "
      "rejects a candidate. A good candidate is rejected if it explains less than the selected "
      "one.",
      {{"head", {"kind", "reason for the rejection", "BIC", "held-out gain"}}, {"rows", rows}});
}

Json ambiguous_section(const TraceResult& r) {
  Json rows = Json::array();
  for (const Ambiguity& a : r.ambiguous)
    rows.push_back({fmt::format("{}", fmt::join(a.kinds, ", ")), a.why, a.would_separate});
  return section("Aliases", "Each of these kinds explains this record equally well.",
                 {{"head", {"kinds", "why", "run that would separate them"}}, {"rows", rows}});
}

// TraceResult::identifiable holds kinds and, for sets without time, sentences.
bool is_kind(const std::string& text) {
  return text.find(' ') == std::string::npos;
}

Json blind_section(const TraceResult& r) {
  std::vector<std::pair<std::string, std::vector<std::string>>> kinds_by_reason;
  for (const auto& one : not_shown(r)) {
    const auto same = std::find_if(kinds_by_reason.begin(), kinds_by_reason.end(),
                                   [&](const auto& row) { return row.first == one.second; });
    if (same == kinds_by_reason.end())
      kinds_by_reason.push_back({one.second, {one.first}});
    else
      same->second.push_back(one.first);
  }
  Json rows = Json::array();
  for (const auto& [why, of] : kinds_by_reason)
    rows.push_back({fmt::format("{}", fmt::join(of, ", ")), why});
  std::vector<std::string> kinds;
  std::copy_if(r.identifiable.begin(), r.identifiable.end(), std::back_inserter(kinds), is_kind);
  std::string note;
  if (!kinds.empty())
    note = fmt::format("Identifiable at the smallest size worth reporting, and absent: {}. ",
                       fmt::join(kinds, ", "));
  if (r.not_identifiable.empty() && kinds.empty())
    note = "The record was not compared with the catalogue.";
  else if (!rows.empty())
    note += "Not identifiable:";
  return section("Effects that this record cannot show", note,
                 {{"head", {"kinds", "why"}}, {"rows", rows}});
}

Json said_section(const TraceResult& r) {
  Json rows = Json::array();
  for (const std::string& line : r.identifiable)
    if (!is_kind(line)) rows.push_back({line});
  return section("Further results", "", {{"head", {"measured"}}, {"rows", rows}});
}

Json health_section(const TraceResult& r) {
  Json rows = Json::array();
  for (const std::string& line : r.health) rows.push_back({line});
  if (rows.empty()) rows.push_back({"no gaps, clipping or repeated samples"});
  return section("Data health", "", {{"head", {"finding in the samples"}}, {"rows", rows}});
}

}  // namespace

std::string number_with_sigma(double value, const std::optional<double>& sigma) {
  if (!sigma || !(*sigma > 0)) return fmt::format("{:.4g}", value);
  const int digits =
      value == 0
          ? 4
          : std::clamp(static_cast<int>(std::floor(std::log10(std::abs(value) / *sigma))) + 2, 2,
                       8);
  return fmt::format("{:.{}g} +- {:.2g}", value, digits, *sigma);
}

std::string parameters_text(const TracedEffect& effect) {
  std::vector<std::string> parts;
  for (const TracedParameter& p : effect.parameters) {
    const std::string name = spaced(p.name);
    if (!p.text.empty()) {
      parts.push_back(name + " " + p.text);
      continue;
    }
    const bool absent = p.value == 0 && !p.sigma && (p.name == "frequency" || p.name == "order");
    if (absent) continue;
    const std::string unit = unit_words(p.unit);
    parts.push_back(fmt::format("{} {}{}{}", name, number_with_sigma(p.value, p.sigma),
                                unit.empty() ? "" : " ", unit));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

Json effects_table(const TraceResult& r) {
  Json rows = Json::array();
  for (const TracedEffect& e : r.effects) rows.push_back(row_of(e));
  return {{"head",
           {"effect", "equation", "parameters", "BIC", "whitened energy of held-out rows falls by",
            "p-value", "size / smallest worth reporting", "aliases"}},
          {"rows", rows}};
}

Json errors_table(const TraceResult& r) {
  Json rows = Json::array();
  const auto add = [&](const char* name, const std::optional<EquationError>& e) {
    if (!e) return;
    rows.push_back({fmt::format("{} ({})", name, e->unit), number(e->before.train),
                    number(e->after.train), number(e->before.held_out), number(e->after.held_out),
                    number(e->noise_floor), number(e->no_change), p_value(e->whiteness_p_value),
                    std::to_string(e->rows)});
  };
  // Sets without time and logs of angle and current have errors of their own quantities.
  add(r.electrical && r.electrical->unit == "V" ? "voltage, each axis" : "electrical",
      r.electrical);
  add(r.mechanical && r.mechanical->unit == "Nm" ? "torque" : "mechanical", r.mechanical);
  add("bus voltage", r.bus);
  return {{"head",
           {"equation, rms error", "before, fitted rows", "after, fitted rows", "before, held out",
            "after, held out", "noise floor", "if nothing changed", "whiteness (p)", "rows"}},
          {"rows", rows}};
}

Json files_table(const TraceResult& r) {
  Json rows = Json::array();
  const auto with_unit = [](double value, const std::string& unit) {
    return std::isfinite(value) ? fmt::format("{:.4g} {}", value, unit) : std::string("-");
  };
  for (const FileError& f : r.files)
    rows.push_back({f.path, f.held_out ? "held out" : "fitted", std::to_string(f.rows),
                    f.signals.empty() ? "-" : fmt::format("{}", fmt::join(f.signals, ", ")),
                    with_unit(f.before, f.unit), with_unit(f.after, f.unit),
                    with_unit(f.no_change, f.unit), with_unit(f.noise, f.unit)});
  return {{"head",
           {"file", "role", "rows", "signals", "before", "after", "if nothing changed", "noise"}},
          {"rows", rows}};
}

Json refused_table(const TraceResult& r) {
  Json rows = Json::array();
  for (const Refused& x : r.refused)
    rows.push_back({x.kind, x.rule, x.file.empty() ? "all together" : x.file, x.text});
  return {{"head", {"claim", "rule", "file", "why"}}, {"rows", rows}};
}

Json inconsistent_table(const TraceResult& r) {
  Json rows = Json::array();
  for (const Inconsistency& x : r.inconsistent)
    rows.push_back(
        {x.file.empty() ? x.quantity : x.quantity + " of " + x.file, x.expected, x.found, x.hint});
  return {{"head", {"quantity", "expected", "found", "may be"}}, {"rows", rows}};
}

std::vector<Json> closing_sections(const TraceResult& r) {
  std::vector<Json> sections;
  if (!r.ambiguous.empty()) sections.push_back(ambiguous_section(r));
  if (!r.rejected.empty()) sections.push_back(considered_section(r));
  if (!std::all_of(r.identifiable.begin(), r.identifiable.end(), is_kind))
    sections.push_back(said_section(r));
  sections.push_back(blind_section(r));
  sections.push_back(health_section(r));
  return sections;
}

}  // namespace twinrate::report

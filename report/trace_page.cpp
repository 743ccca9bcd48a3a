#include "report/trace_page.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "report/parts.hpp"
#include "report/trace_parts.hpp"

namespace twinrate {
namespace {

using namespace report;

// The next step for the user.
std::string advice(const TraceResult& r) {
  if (r.verdict == "traced")
    return "Next: compare each effect with its picture, run the drive with extended.toml in place "
           "of the drive file, and trace a new log with it. Nothing should then be missing.";
  if (r.verdict == "nothing_missing")
    return "Next: keep the drive file. The last section lists the effects that this record cannot "
           "show.";
  if (r.verdict == "ambiguous")
    return r.effects.empty()
               ? "Next: record the data that the headline asks for, and trace again."
               : "Next: make the run that the table of aliases asks for, and trace both together. "
                 "Until then the cause may be either of the names.";
  if (r.verdict == "unexplained")
    return std::string("Next: look at the pictures") +
           (r.refused.empty() ? ". " : " and at the table of refused claims. ") +
           (r.effects.empty() ? "extended.toml adds no effect of the catalogue. "
                              : "extended.toml holds only the effects that passed every test. ") +
           "If the picture has a cause that you know (a load, a coupling, a filter), take it away "
           "or log it; else record a longer run with more speeds and loads, and trace again.";
  if (r.verdict == "inconsistent")
    return "No effect was looked for. Next: correct the quantities in the first table (the scale "
           "in the map of the import, or the value in the drive file), and trace again.";
  return "";
}

Json verdict_of(const TraceResult& r) {
  const bool sure = !r.interrupted && (r.verdict == "traced" || r.verdict == "nothing_missing");
  std::string name = r.verdict;
  for (char& c : name)
    if (c == '_') c = ' ';
  return {{"state", sure ? "good" : "unsure"},
          {"headline", r.sentence},
          {"text", fmt::format("Verdict: {}. {}", name, advice(r))}};
}

Json summary_of(const TraceResult& r) {
  Json rows = Json::array();
  if (!r.inconsistent.empty()) {  // nothing was fitted
    rows.push_back({"logs", fmt::format("{}", fmt::join(r.sources, ", "))});
    return rows;
  }
  rows.push_back({"fitted to", fmt::format("{}", fmt::join(r.sources, ", "))});
  const bool of_a_set =
      r.horizon_s == 0 && !r.pictures.empty() && r.pictures.front().heading.empty();
  rows.push_back({"hold-out", r.held_out_sources.empty()
                                  ? std::string(of_a_set ? "points of the same set"
                                                         : "blocks of the same record")
                                  : fmt::format("{}", fmt::join(r.held_out_sources, ", "))});
  if (!r.excluded.empty())
    rows.push_back({"not looked for", fmt::format("{}", fmt::join(r.excluded, ", "))});
  if (r.horizon_s > 0)
    rows.push_back({"compared every", fmt::format("{:.3g} ms", 1e3 * r.horizon_s)});
  rows.push_back({"traced in", fmt::format("{:.1f} s", r.seconds)});
  return rows;
}

Json claims(const TraceResult& r) {
  Json section = {{"heading", "What the model lacks"},
                  {"note",
                   "+- is one standard deviation. BIC: change of the information criterion by the "
                   "effect, negative is better. p-value: probability of this gain by chance."},
                  {"columns", 1},
                  {"figures", Json::array()},
                  {"table", effects_table(r)}};
  if (r.effects.empty()) {
    section["note"] = r.excluded.empty() ? "No effect of the catalogue."
                                         : "No effect of the kinds that were looked for.";
    section.erase("table");
  }
  return section;
}

Json table_section(const char* heading, const char* note, Json table) {
  return {{"heading", heading},
          {"note", note},
          {"columns", 1},
          {"figures", Json::array()},
          {"table", std::move(table)}};
}

Json files(const TraceResult& r) {
  return table_section(
      "Each file",
      "Rms error of the main equation over the held-out rows of the file, or over all its rows if "
      "none is held out: with the drive file as it is, with the effects above, with a prediction "
      "of no change, and of the noise alone. A dash: not known, or nothing changes with time.",
      files_table(r));
}

Json refusals(const TraceResult& r) {
  return table_section("Refused claims",
                       "These would lower the error of the fitted rows, but did not pass a test on "
                       "rows that were not fitted. They are not in extended.toml.",
                       refused_table(r));
}

Json contradictions(const TraceResult& r) {
  return table_section("What does not belong together",
                       "The log against the drive file, before any effect is looked for.",
                       inconsistent_table(r));
}

Json errors(const TraceResult& r) {
  return {
      {"heading", "Error before and after"},
      {"note",
       "One-step error of the equations, rms. Held-out rows were not fitted. Noise floor: the "
       "error that the noise of the samples causes. If nothing changed: the rms of the terms that "
       "the equation balances."},
      {"columns", 1},
      {"figures", Json::array()},
      {"table", errors_table(r)}};
}

std::string heading_of(const TracedEffect& e) {
  std::string heading = fmt::format("{}: {}", e.effect->kind(), parameters_text(e));
  if (!e.aliases.empty()) heading += fmt::format(" (or {})", fmt::join(e.aliases, ", "));
  return heading;
}

void append(Json& sections, std::vector<Json> more) {
  for (Json& section : more) sections.push_back(std::move(section));
}

}  // namespace

report::ChannelWords report::words_of(const std::string& channel) {
  if (channel == "torque") return {"torque", "Nm"};
  return {channel + " voltage", "V"};
}

const TraceSeries& report::series_of(const TraceResult& r, const std::string& channel) {
  return channel == "d" ? r.series_d : channel == "q" ? r.series_q : r.series_torque;
}

void write_trace_page(const TraceResult& r, const TracePage& page, const std::string& out_path) {
  Json sections = Json::array();
  if (!r.inconsistent.empty()) sections.push_back(contradictions(r));
  if (r.inconsistent.empty()) sections.push_back(claims(r));
  if (!r.refused.empty()) sections.push_back(refusals(r));
  if (r.electrical || r.mechanical) sections.push_back(errors(r));
  if (!r.files.empty()) sections.push_back(files(r));
  for (const TracedEffect& e : r.effects) {
    Json section =
        effect_section(r, e, page.n_p, heading_of(e), fmt::format("{}.", e.effect->meaning()));
    if (!section.is_null()) sections.push_back(std::move(section));
  }
  append(sections, picture_sections(r));
  append(sections, unexplained_sections(r, page.n_p));
  append(sections, residual_sections(r));
  append(sections, closing_sections(r));
  Json content;
  content["subtitle"] = fmt::format("Trace of {}", fmt::join(r.sources, ", "));
  content["revision"] = page.revision;
  content["verdict"] = verdict_of(r);
  content["summary"] = summary_of(r);
  content["sections"] = std::move(sections);
  content["config"] = page.extended_toml;
  content["config_title"] = "The extended drive file, extended.toml";
  write_page(std::move(content), fmt::format("What the model of {} lacks", page.drive), out_path);
}

}  // namespace twinrate

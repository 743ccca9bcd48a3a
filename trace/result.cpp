#include "trace/result.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "model/fields.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

using json = nlohmann::ordered_json;

json number(double value) {
  return std::isfinite(value) ? json(value) : json(nullptr);
}

json parameter_json(const TracedParameter& p) {
  json row;
  if (p.text.empty()) {
    row = {{"value", number(p.value)}, {"unit", p.unit}};
  } else {
    row = {{"value", p.text}};
  }
  if (p.sigma) row["sigma"] = number(*p.sigma);
  return row;
}

// `all`: the files of the trace. An effect that was fitted to all of them has all as its files.
json effect_json(const TracedEffect& e, const std::vector<std::string>& all) {
  json parameters = json::object();
  for (const TracedParameter& p : e.parameters) parameters[p.name] = parameter_json(p);
  json evidence = {{"holdout_gain", number(e.held_out_gain)},
                   {"delta_bic", number(e.delta_bic)},
                   {"f_p_value", number(e.p_value)},
                   {"times_smallest_worth_reporting", number(e.materiality)}};
  if (e.only_in_log) evidence["only_in_log"] = true;
  if (e.from_samples) evidence = {{"found_in", "raw samples"}};
  return {{"kind", e.effect->kind()},
          {"equation", e.equation},
          {"parameters", parameters},
          {"evidence", evidence},
          {"aliases", e.aliases},
          {"from_s", e.from_s ? number(*e.from_s) : json(nullptr)},
          {"to_s", e.to_s ? number(*e.to_s) : json(nullptr)},
          {"files", e.only_in_part || e.from_samples ? e.files : all}};
}

std::vector<std::string> files_of(const TraceResult& r) {
  std::vector<std::string> files = r.sources;
  for (const std::string& path : r.held_out_sources)
    if (std::find(files.begin(), files.end(), path) == files.end()) files.push_back(path);
  return files;
}

json changes_json(const TraceResult& r) {
  json list = json::array();
  for (const DriveChange& c : r.changes)
    list.push_back({{"t_s", c.between.empty() ? number(c.t_s) : json(nullptr)},
                    {"earliest_s", c.between.empty() ? number(c.from_s) : json(nullptr)},
                    {"latest_s", c.between.empty() ? number(c.to_s) : json(nullptr)},
                    {"file", c.file},
                    {"between", c.between},
                    {"before", c.before},
                    {"behind", c.behind}});
  return list;
}

json pair_json(const ErrorPair& e) {
  return {{"train", number(e.train)}, {"holdout", number(e.held_out)}};
}

json equation_json(const std::optional<EquationError>& e) {
  if (!e) return json::object();
  return {{"unit", e->unit},
          {"no_change", number(e->no_change)},
          {"before", pair_json(e->before)},
          {"after", pair_json(e->after)},
          {"noise_floor", number(e->noise_floor)},
          {"whiteness_p_value", number(e->whiteness_p_value)}};
}

json error_json(const TraceResult& r) {
  const auto& main = r.main_equation == "electrical" ? r.electrical : r.mechanical;
  json error = {{"signal", "one_step_prediction"}, {"horizon_s", r.horizon_s}};
  if (main) error.update(equation_json(main));
  error["equation"] = r.main_equation;
  for (const FileError& f : r.files)
    error["files"].push_back({{"file", f.path},
                              {"role", f.held_out ? "holdout" : "train"},
                              {"unit", f.unit},
                              {"rows", f.rows},
                              {"signals", f.signals},
                              {"before", number(f.before)},
                              {"after", number(f.after)},
                              {"no_change", number(f.no_change)},
                              {"noise", number(f.noise)}});
  error["by_equation"] = {{"electrical", equation_json(r.electrical)},
                          {"mechanical", equation_json(r.mechanical)}};
  if (r.bus) error["by_equation"]["bus"] = equation_json(r.bus);
  return error;
}

json stop_gap_json(const TraceResult& r) {
  json list = json::array();
  for (const TracedEffect& e : r.stop_gaps) {
    json row = effect_json(e, files_of(r));
    row["in_extended_toml"] = !e.only_in_part;
    list.push_back(row);
  }
  for (const CorrectionTable& c : r.corrections)
    list.push_back({{"kind", "table"},
                    {"regressor", c.regressor},
                    {"channel", c.channel},
                    {"periodic", c.periodic},
                    {"x", c.x},
                    {"value", c.value},
                    {"before", pair_json(c.before)},
                    {"after", pair_json(c.after)},
                    {"in_extended_toml", false}});
  return list;
}

}  // namespace

std::vector<TracedParameter> traced_parameters(const Effect& effect,
                                               const std::map<std::string, double>& sigma) {
  std::vector<TracedParameter> list;
  for (const NumericKey& key : numeric_keys(effect)) {
    if (key.key == "start_s") continue;  // of the log's clock, which is not traced
    const auto [name, unit] = split_unit(key.key);
    TracedParameter p{
        .name = name, .unit = unit, .value = key.value, .sigma = {}, .text = key.text};
    const auto found = sigma.find(key.key);
    if (found != sigma.end()) p.sigma = found->second;
    list.push_back(std::move(p));
  }
  return list;
}

namespace {

json refused_json(const std::vector<Refused>& refused) {
  json list = json::array();
  for (const Refused& x : refused)
    list.push_back({{"kind", x.kind},
                    {"rule", x.rule},
                    {"file", x.file},
                    {"number", number(x.number)},
                    {"why", x.text}});
  return list;
}

json inconsistent_json(const std::vector<Inconsistency>& inconsistent) {
  json list = json::array();
  for (const Inconsistency& x : inconsistent)
    list.push_back({{"quantity", x.quantity},
                    {"expected", x.expected},
                    {"found", x.found},
                    {"hint", x.hint},
                    {"file", x.file}});
  return list;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> not_shown(const TraceResult& r) {
  auto list = r.not_identifiable;
  for (const std::string& kind : r.excluded) list.emplace_back(kind, "excluded by --exclude");
  return list;
}

std::string to_json(const TraceResult& r) {
  json effects = json::array(), ambiguous = json::array(), where = json::array(),
       not_identifiable = json::array(), rejected = json::array();
  for (const TracedEffect& e : r.effects) effects.push_back(effect_json(e, files_of(r)));
  for (const Ambiguity& a : r.ambiguous)
    ambiguous.push_back({{"kinds", a.kinds}, {"why", a.why}, {"would_separate", a.would_separate}});
  for (const Structure& s : r.unexplained) {
    json row = {{"regressor", s.regressor}, {"share", number(s.share)}, {"equation", s.equation}};
    if (s.frequency_Hz > 0) row["frequency_Hz"] = s.frequency_Hz;
    if (s.order > 0) row["order"] = s.order;
    row["what"] = s.text;
    where.push_back(row);
  }
  json constants = json::object();
  for (const TracedParameter& p : r.constants) constants[p.name] = parameter_json(p);
  for (const auto& [kind, why] : not_shown(r))
    not_identifiable.push_back({{"kind", kind}, {"why", why}});
  for (const Rejected& x : r.rejected)
    rejected.push_back({{"kind", x.kind},
                        {"delta_bic", number(-x.score_gain)},
                        {"holdout_gain", number(x.held_out_gain)},
                        {"why", x.why}});
  return json{{"verdict", r.verdict},
              {"sentence", r.sentence},
              {"interrupted", r.interrupted},
              {"data", r.sources},
              {"holdout_data", r.held_out_sources},
              {"health", r.health},
              {"effects", effects},
              {"ambiguous", ambiguous},
              {"changes", changes_json(r)},
              {"unexplained", {{"structured", r.structured}, {"where", where}}},
              {"stop_gap", stop_gap_json(r)},
              {"error", error_json(r)},
              {"constants", constants},
              {"refused", refused_json(r.refused)},
              {"inconsistent", inconsistent_json(r.inconsistent)},
              {"identifiable", r.identifiable},
              {"not_identifiable", not_identifiable},
              {"considered", rejected},
              {"seconds", r.seconds}}
             .dump(2) +
         "\n";
}

}  // namespace twinrate

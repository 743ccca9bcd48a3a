#include "loop/drive_schema.hpp"

#include <nlohmann/json.hpp>

#include "controller/controller.hpp"
#include "estimator/registry.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

Json number_schema(double lo, double hi) {
  return {{"type", "number"}, {"minimum", lo}, {"maximum", hi}};
}
Json name_schema(std::span<const char* const> names) {
  return {{"type", "string"}, {"enum", std::vector<std::string>(names.begin(), names.end())}};
}
// A value, or steps [[t_s, value], ..].
Json profile_schema(const Json& value) {
  const Json step = {{"type", "array"},
                     {"items", {{{"type", "number"}}, value}},
                     {"minItems", 2},
                     {"maxItems", 2}};
  return {{"anyOf", {value, {{"type", "array"}, {"items", step}, {"minItems", 1}}}}};
}
Json table_schema(Json properties) {
  return {
      {"type", "object"}, {"properties", std::move(properties)}, {"additionalProperties", false}};
}

// One property a key.
class SchemaWriter final : public FieldVisitor {
 public:
  Json properties = Json::object();

  void number(const char* key, double& value, double lo, double hi, const char* meaning,
              Presence presence) override {
    Json schema = number_schema(lo, hi);
    if (presence == Presence::kOptional) schema["default"] = value;
    add(key, std::move(schema), meaning);
  }
  void integer(const char* key, int& value, int lo, int hi, const char* meaning,
               Presence presence) override {
    Json schema = {{"type", "integer"}, {"minimum", lo}, {"maximum", hi}};
    if (presence == Presence::kOptional) schema["default"] = value;
    add(key, std::move(schema), meaning);
  }
  void boolean(const char* key, bool& value, const char* meaning) override {
    add(key, {{"type", "boolean"}, {"default", value}}, meaning);
  }
  void text(const char* key, std::string&, const char* meaning) override {
    add(key, {{"type", "string"}}, meaning);
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char* meaning) override {
    Json schema = name_schema(names);
    schema["default"] = names[static_cast<std::size_t>(index)];
    add(key, std::move(schema), meaning);
  }
  void numbers(const char* key, std::span<double> values, double lo, double hi,
               const char* meaning) override {
    add(key,
        {{"type", "array"},
         {"items", number_schema(lo, hi)},
         {"minItems", values.size()},
         {"maxItems", values.size()}},
        meaning);
  }
  void integers(const char* key, std::vector<int>&, int lo, int hi, std::size_t most,
                const char* meaning) override {
    add(key,
        {{"type", "array"},
         {"items", {{"type", "integer"}, {"minimum", lo}, {"maximum", hi}}},
         {"maxItems", most}},
        meaning);
  }
  void profile(const char* key, Profile&, double lo, double hi, const char* meaning) override {
    add(key, profile_schema(number_schema(lo, hi)), meaning);
  }
  void choice_profile(const char* key, Profile&, std::span<const char* const> names,
                      const char* meaning) override {
    add(key, profile_schema(name_schema(names)), meaning);
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    SchemaWriter inner;
    fields(inner);
    properties[key] = table_schema(std::move(inner.properties));
  }

 private:
  void add(const char* key, Json schema, const char* meaning) {
    schema["description"] = meaning;
    properties[key] = std::move(schema);
  }
};

template <class Fields>
Json properties_of(Fields&& fields) {
  SchemaWriter writer;
  fields(writer);
  return std::move(writer.properties);
}

// [estimator] or [controller]: its own keys, and a table for each kind.
template <class Section, class MakeBuilder>
Json kinds_schema(Section section, const std::vector<std::string>& kinds, MakeBuilder builder_of) {
  Json properties = properties_of([&](FieldVisitor& f) { section.fields(f); });
  properties["kind"]["enum"] = kinds;
  for (const std::string& kind : kinds) {
    const auto builder = builder_of(kind);
    properties[kind] = table_schema(properties_of([&](FieldVisitor& f) { builder->fields(f); }));
  }
  return table_schema(std::move(properties));
}

Json effect_schema(const std::string& kind) {
  const auto effect = make_effect(kind);
  Json properties = {{"kind", {{"const", kind}, {"description", effect->meaning()}}},
                     {"used_in", name_schema(kUsedInNames)},
                     {"from_s", number_schema(0, 1e6)},
                     {"known_from_s", number_schema(0, 1e6)},
                     {"known_to_s", number_schema(0, 1e6)}};
  properties.update(properties_of([&](FieldVisitor& f) { effect->fields(f); }));
  Json schema = table_schema(std::move(properties));
  schema["required"] = {"kind"};
  return schema;
}

Json effects_schema() {
  Json kinds = Json::array();
  for (const std::string& kind : effect_kinds()) kinds.push_back(effect_schema(kind));
  return {{"type", "array"}, {"items", {{"oneOf", kinds}}}};
}

}  // namespace

std::string drive_schema() {
  DriveConfig d;
  Json properties = {{"$schema", {{"type", "string"}}},
                     {"name", {{"type", "string"}, {"description", "name of the drive"}}},
                     {"preset", {{"type", "string"}, {"enum", preset_names()}}},
                     {"start", name_schema(kStartNames)}};
  const auto add = [&](const char* key, auto& section) {
    properties[key] = table_schema(properties_of([&](FieldVisitor& f) { section.fields(f); }));
  };
  add("machine", d.machine);
  add("inverter", d.inverter);
  add("sensors", d.sensors);
  add("rates", d.rates);
  add("gain", d.gain);
  add("reference", d.reference);
  add("load", d.load);
  add("run", d.run);
  for (const OwnedTable& table : owned_tables())
    properties[table.path] = table_schema(properties_of(table.fields));
  properties["estimator"] = kinds_schema(d.estimator, filter_kinds(),
                                         [](const std::string& k) { return filter_builder(k); });
  properties["controller"] = kinds_schema(
      d.controller, controller_kinds(), [](const std::string& k) { return controller_builder(k); });
  properties["effect"] = effects_schema();
  Json schema = {{"$schema", "http://json-schema.org/draft-07/schema#"},
                 {"title", "drive file of twinrate"}};
  schema.update(table_schema(std::move(properties)));
  return schema.dump(1) + "\n";
}

}  // namespace twinrate

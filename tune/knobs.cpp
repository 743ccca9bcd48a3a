#include "tune/knobs.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string_view>

#include "estimator/registry.hpp"

namespace twinrate::tune {
namespace {

// Weights begin with "Q", "R" or "P0", the integral gain with "L".
bool is_weight(std::string_view key) {
  return key.starts_with("Q") || key.starts_with("R") || key.starts_with("P0");
}

class Collector final : public FieldVisitor {
 public:
  Collector(std::string table, Knobs& knobs) : table_(std::move(table)), knobs_(knobs) {}

  void number(const char* key, double& value, double, double, const char*, Presence) override {
    if (!is_weight(key) && !std::string_view(key).starts_with("L")) return;
    add_key(key, {value});
    if (value != 0) knobs_.list.push_back({path(key), {}, value, is_weight(key)});
  }
  void numbers(const char* key, std::span<double> values, double, double, const char*) override {
    if (!is_weight(key)) return;
    add_key(key, {values.begin(), values.end()});
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (values[i] == 0) continue;
      Knob* same = nullptr;
      for (Knob& knob : knobs_.list)
        if (knob.key == path(key) && knob.value == values[i]) same = &knob;
      if (!same) same = &knobs_.list.emplace_back(Knob{path(key), {}, values[i]});
      same->index.push_back(static_cast<int>(i));
    }
  }
  void integer(const char*, int&, int, int, const char*, Presence) override {}
  void boolean(const char*, bool&, const char*) override {}
  void text(const char*, std::string&, const char*) override {}
  void choice(const char*, int&, std::span<const char* const>, const char*) override {}
  void integers(const char*, std::vector<int>&, int, int, std::size_t, const char*) override {}
  void profile(const char*, Profile&, double, double, const char*) override {}
  void choice_profile(const char*, Profile&, std::span<const char* const>, const char*) override {}
  void table(const char*, const std::function<void(FieldVisitor&)>&) override {}

 private:
  std::string path(const char* key) const { return table_ + "." + key; }
  void add_key(const char* key, std::vector<double> values) {
    knobs_.keys.emplace_back(path(key), std::move(values));
  }
  std::string table_;
  Knobs& knobs_;
};

std::string text_of(const Knobs& knobs, const std::string& key, const std::vector<double>& values) {
  for (const Knob& knob : knobs.list)
    if (knob.key == key && knob.index.empty()) return fmt::format("{:.6g}", values.front());
  return fmt::format("[{:.6g}]", fmt::join(values, ", "));
}

}  // namespace

void Knobs::set(std::size_t knob, double value) {
  Knob& k = list[knob];
  k.value = value;
  for (auto& [key, values] : keys) {
    if (key != k.key) continue;
    if (k.index.empty()) values.front() = value;
    for (int i : k.index) values[static_cast<std::size_t>(i)] = value;
  }
}

void Knobs::scale_weights(double factor) {
  for (std::size_t i = 0; i < list.size(); ++i)
    if (list[i].is_weight) set(i, factor * list[i].value);
}

std::vector<std::string> Knobs::overrides() const {
  std::vector<std::string> result;
  for (const auto& [key, values] : keys) result.push_back(key + "=" + text_of(*this, key, values));
  return result;
}

std::string Knobs::table() const {
  if (keys.empty()) return {};
  const std::string& first = keys.front().first;
  std::string text = fmt::format("[{}]\n", first.substr(0, first.rfind('.')));
  for (const auto& [key, values] : keys)
    text += fmt::format("{} = {}\n", key.substr(key.rfind('.') + 1), text_of(*this, key, values));
  return text;
}

Knobs knobs_of(Config& config) {
  const std::string& kind = config.drive().estimator.kind;
  const auto builder = filter_builder(kind, config.drive());
  const std::string table = "estimator." + kind;
  config.read_table(table, [&](FieldVisitor& f) { builder->fields(f); });
  Knobs knobs;
  Collector collector(table, knobs);
  builder->fields(collector);
  return knobs;
}

}  // namespace twinrate::tune

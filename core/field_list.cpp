#include "core/field_list.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace twinrate {
namespace {

class Lister final : public FieldVisitor {
 public:
  explicit Lister(std::vector<FieldRow>& rows, std::string prefix = "")
      : rows_(rows), prefix_(std::move(prefix)) {}

  void number(const char* key, double& value, double lo, double hi, const char* meaning,
              Presence presence) override {
    FieldRow& row = add(key, "number", fmt::format("{}", value), meaning, presence);
    row.value = value;
    set_range(row, lo, hi);
  }
  void integer(const char* key, int& value, int lo, int hi, const char* meaning,
               Presence presence) override {
    FieldRow& row = add(key, "whole number", std::to_string(value), meaning, presence);
    row.value = value;
    set_range(row, lo, hi);
  }
  void boolean(const char* key, bool& value, const char* meaning) override {
    add(key, "boolean", value ? "true" : "false", meaning).value = value;
  }
  void text(const char* key, std::string& value, const char* meaning) override {
    add(key, "text", value, meaning);
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char* meaning) override {
    FieldRow& row = add(key, "choice", names[static_cast<std::size_t>(index)], meaning);
    row.value = index;
    row.choices.assign(names.begin(), names.end());
  }
  void numbers(const char* key, std::span<double> values, double lo, double hi,
               const char* meaning) override {
    set_range(add(key, "numbers", fmt::format("[{}]", fmt::join(values, ", ")), meaning), lo, hi);
  }
  void integers(const char* key, std::vector<int>& values, int lo, int hi, std::size_t,
                const char* meaning) override {
    set_range(add(key, "whole numbers", fmt::format("[{}]", fmt::join(values, ", ")), meaning), lo,
              hi);
  }
  void profile(const char* key, Profile& value, double lo, double hi,
               const char* meaning) override {
    FieldRow& row = add(key, "profile", "profile", meaning);
    row.value = value.at(0);
    if (value.is_constant()) row.value_text = fmt::format("{}", row.value);
    set_range(row, lo, hi);
  }
  void choice_profile(const char* key, Profile& indices, std::span<const char* const> names,
                      const char* meaning) override {
    const auto index = static_cast<std::size_t>(indices.at(0));
    FieldRow& row = add(key, "choice", names[index], meaning);
    row.value = indices.at(0);
    row.choices.assign(names.begin(), names.end());
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    Lister sub(rows_, prefix_ + key + ".");
    fields(sub);
  }

 private:
  FieldRow& add(const char* key, const char* type, std::string value, const char* meaning,
                Presence presence = Presence::kOptional) {
    FieldRow row;
    row.key = prefix_ + key;
    row.type = type;
    row.required = presence == Presence::kRequired;
    row.value_text = std::move(value);
    row.meaning = meaning;
    return rows_.emplace_back(std::move(row));
  }
  static void set_range(FieldRow& row, double lo, double hi) {
    row.lo = lo;
    row.hi = hi;
  }

  std::vector<FieldRow>& rows_;
  std::string prefix_;
};

}  // namespace

std::vector<FieldRow> list_fields(const std::function<void(FieldVisitor&)>& fields) {
  std::vector<FieldRow> rows;
  Lister lister(rows);
  fields(lister);
  return rows;
}

}  // namespace twinrate

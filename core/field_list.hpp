// The fields of a parameter struct as a list: for pages, tables and JSON that describe them.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "model/fields.hpp"

namespace twinrate {

struct FieldRow {
  std::string key;   // unit included; of a nested table "table.key"
  std::string type;  // number, whole number, boolean, text, choice, numbers, profile
  bool required = false;
  double lo = 0, hi = 0;   // of numbers
  double value = 0;        // in the struct: the default, or the value of a drive file
  std::string value_text;  // the same for people
  std::vector<std::string> choices;
  std::string meaning;
};

std::vector<FieldRow> list_fields(const std::function<void(FieldVisitor&)>& fields);

}  // namespace twinrate

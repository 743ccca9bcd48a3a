#include "core/config_difference.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <sstream>

#include "core/config.hpp"

namespace twinrate {
namespace {

using Keys = std::map<std::string, std::string>;

bool holds_tables(const toml::array& array) {
  return !array.empty() &&
         std::all_of(array.begin(), array.end(), [](const auto& n) { return n.is_table(); });
}

void collect(const toml::node& node, const std::string& path, Keys& keys) {
  if (const toml::table* table = node.as_table()) {
    for (const auto& [key, value] : *table)
      collect(value, path + (path.empty() ? "" : ".") + std::string(key.str()), keys);
    return;
  }
  const toml::array* array = node.as_array();
  if (array && holds_tables(*array)) {
    for (std::size_t i = 0; i < array->size(); ++i)
      collect(*array->get(i), fmt::format("{}[{}]", path, i), keys);
    return;
  }
  if (const auto number = node.value_exact<double>()) {
    keys[path] = fmt::format("{}", *number);
    return;
  }
  std::ostringstream text;
  node.visit([&](const auto& value) { text << value; });
  keys[path] = text.str();
}

Keys keys_of(const std::string& toml_text) {
  Keys keys;
  try {
    collect(toml::parse(toml_text), "", keys);
  } catch (const toml::parse_error& error) {
    throw BadInput(fmt::format("drive file of a run: {}", error.description()));
  }
  return keys;
}

}  // namespace

std::vector<DifferingKey> differing_keys(const std::vector<std::string>& toml_texts) {
  std::map<std::string, std::vector<std::string>> values;
  for (std::size_t i = 0; i < toml_texts.size(); ++i) {
    for (auto& [path, value] : keys_of(toml_texts[i])) {
      auto& row = values[path];
      row.resize(toml_texts.size());
      row[i] = value;
    }
  }
  std::vector<DifferingKey> differing;
  for (auto& [path, row] : values)
    if (std::adjacent_find(row.begin(), row.end(), std::not_equal_to<>()) != row.end())
      differing.push_back({path, row});
  return differing;
}

}  // namespace twinrate

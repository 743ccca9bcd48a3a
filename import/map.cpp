#include "import/map.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "core/config.hpp"
#include "core/toml_text.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

// One table of the map file. Keys are taken one by one; require_known() refuses the remaining keys.
class MapTable {
 public:
  MapTable(const std::string& file, std::string path, const toml::table& table)
      : file_(file), path_(std::move(path)), table_(table) {}

  std::string where(const toml::node& node) const {
    return fmt::format("{}:{}", file_, node.source().begin.line);
  }
  [[noreturn]] void fail(const toml::node& node, const std::string& key,
                         const std::string& what) const {
    throw BadInput(fmt::format("{}: {}.{}: {}", where(node), path_, key, what));
  }
  const toml::node* take(const std::string& key) {
    known_.push_back(key);
    return table_.get(key);
  }
  double number(const std::string& key, double otherwise) {
    const toml::node* node = take(key);
    if (!node) return otherwise;
    const auto value = node->value<double>();
    if (!node->is_number() || !value || !std::isfinite(*value))
      fail(*node, key, "a number allowed");
    return *value;
  }
  std::string text(const std::string& key, const std::string& otherwise) {
    const toml::node* node = take(key);
    if (!node) return otherwise;
    if (!node->is_string()) fail(*node, key, "a text in quotes allowed");
    return node->as_string()->get();
  }
  char character(const std::string& key, char otherwise, const std::string& allowed) {
    const std::string value = text(key, std::string(1, otherwise));
    if (value.size() != 1 || allowed.find(value) == std::string::npos)
      fail(*table_.get(key), key, fmt::format("one of \"{}\" allowed", allowed));
    return value[0];
  }
  void require_known() const {
    for (const auto& [key, node] : table_)
      if (std::find(known_.begin(), known_.end(), key.str()) == known_.end())
        throw BadInput(fmt::format("{}: {}.{}: unknown key; known here: {}", where(node), path_,
                                   key.str(), fmt::join(known_, ", ")));
  }

 private:
  const std::string& file_;
  std::string path_;
  const toml::table& table_;
  std::vector<std::string> known_;
};

void take_from(MapTable& table, ColumnMap& column, const std::string& own_name) {
  const toml::node* from = table.take("from");
  if (!from) {
    column.from = own_name;
  } else if (from->is_integer() && from->as_integer()->get() >= 1) {
    column.number = static_cast<int>(from->as_integer()->get());
  } else if (from->is_string()) {
    column.from = from->as_string()->get();
  } else {
    table.fail(*from, "from", "the name of a column or its number from 1 allowed");
  }
}

ColumnMap read_column(const std::string& file, const std::string& name, const toml::node& node) {
  ColumnMap column;
  column.where = fmt::format("{}:{}", file, node.source().begin.line);
  if (const auto* text = node.as_string()) {
    column.from = text->get();
    return column;
  }
  const auto* inner = node.as_table();
  if (!inner)
    throw BadInput(
        fmt::format("{}: columns.{}: a column name or {{ from, scale, offset, wrap }} allowed",
                    column.where, name));
  MapTable table(file, "columns." + name, *inner);
  take_from(table, column, name);
  column.scale = table.number("scale", 1);
  column.offset = table.number("offset", 0);
  column.wrap = table.number("wrap", 0);
  if (column.wrap != 0 && (name != "theta_m" || column.wrap < 0))
    table.fail(*inner->get("wrap"), "wrap",
               "only for theta_m, the raw value of one period, above 0");
  table.require_known();
  return column;
}

void read_columns(const std::string& file, const toml::table& columns, ImportMap& map) {
  std::vector<std::string> known = canonical_columns();
  for (const auto* more : {&static_columns(), &linear_columns()})
    known.insert(known.end(), more->begin(), more->end());
  for (const auto& [key, node] : columns) {
    const std::string name(key.str());
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw BadInput(fmt::format("{}:{}: columns.{}: unknown column; known: {}", file,
                                 node.source().begin.line, name, fmt::join(known, ", ")));
    map.columns[name] = read_column(file, name, node);
  }
}

// A column of a linear axis and the canonical column, which is multiplied by `power` of the radius.
struct LinearColumn {
  const char *name, *rotary;
  int power;
};
constexpr LinearColumn kLinearColumns[] = {{"x", "theta_m", -1},
                                           {"v", "omega_m", -1},
                                           {"force", "torque", 1},
                                           {"force_ref", "torque_ref", 1}};

void take_linear_columns(ImportMap& map) {
  for (const LinearColumn& linear : kLinearColumns) {
    const auto there = map.columns.find(linear.name);
    if (there == map.columns.end()) continue;
    ColumnMap column = there->second;
    const double factor = linear.power > 0 ? map.radius_m : 1 / map.radius_m;
    column.scale *= factor;
    column.offset *= factor;
    column.turns = false;
    map.columns.erase(there);
    map.columns[linear.rotary] = std::move(column);
    map.linear.emplace_back(linear.name);
  }
}

void refuse_both(const ImportMap& map) {
  for (const LinearColumn& linear : kLinearColumns)
    for (const LinearColumn& other : kLinearColumns) {
      const auto there = map.columns.find(linear.name);
      if (there != map.columns.end() && map.columns.count(other.rotary))
        throw BadInput(
            fmt::format("{}: columns.{}: of a linear axis, but columns.{} is of a rotary "
                        "one; give one kind",
                        there->second.where, linear.name, other.rotary));
    }
}

void read_axis(const std::string& file, const toml::table& axis, ImportMap& map) {
  MapTable table(file, "axis", axis);
  const double travel = table.number("travel_m", kTwoPi);
  if (!(travel > 0)) table.fail(*axis.get("travel_m"), "travel_m", "a number above 0 allowed");
  table.require_known();
  map.radius_m = travel / kTwoPi;
}

void read_time(const std::string& file, const toml::table& time, ImportMap& map) {
  MapTable table(file, "time", time);
  ColumnMap column;
  column.where = table.where(time);
  if (map.columns.count("t"))
    throw BadInput(
        fmt::format("{}: time: give either [time] or columns.t, not both", column.where));
  take_from(table, column, "t");
  const std::string unit = table.text("unit", "s");
  const std::map<std::string, double> units{{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}};
  if (!units.count(unit)) table.fail(*time.get("unit"), "unit", "one of s, ms, us, ns allowed");
  const double scale = table.number("scale", 1);
  if (!(scale > 0)) table.fail(*time.get("scale"), "scale", "a number above 0 allowed");
  column.scale = scale * units.at(unit);
  column.offset = table.number("offset", 0);
  table.require_known();
  map.columns["t"] = column;
}

void read_format(const std::string& file, const toml::table& format, ImportMap& map) {
  MapTable table(file, "file", format);
  map.format.separator = table.character("separator", ',', ",; \t|");
  map.format.decimal = table.character("decimal", '.', ".,");
  const double skip = table.number("skip", 0);
  if (!(skip >= 0 && skip <= 1e6) || skip != std::floor(skip))
    table.fail(*format.get("skip"), "skip", "a whole number of lines from 0 allowed");
  map.format.skip = static_cast<int>(skip);
  map.format.comment = table.text("comment", "#");
  if (const toml::node* header = table.take("header")) {
    if (!header->is_boolean()) table.fail(*header, "header", "true or false allowed");
    map.format.header = header->as_boolean()->get();
  }
  table.require_known();
  if (map.format.separator == map.format.decimal)
    throw BadInput(fmt::format("{}: file: separator and decimal must differ", table.where(format)));
}

const toml::table* table_of(const std::string& file, const toml::table& root, const char* key) {
  const toml::node* node = root.get(key);
  if (node && !node->is_table())
    throw BadInput(fmt::format("{}:{}: {}: a table allowed", file, node->source().begin.line, key));
  return node ? node->as_table() : nullptr;
}

}  // namespace

const std::vector<std::string>& canonical_columns() {
  static const std::vector<std::string> names{
      "t",       "i_a",     "i_b",         "i_c",        "i_alpha", "i_beta", "i_d",
      "i_q",     "u_alpha", "u_beta",      "u_d",        "u_q",     "duty_a", "duty_b",
      "duty_c",  "v_dc",    "theta_m",     "omega_m",    "T_load",  "torque", "torque_ref",
      "i_q_ref", "i_d_ref", "omega_m_ref", "temperature"};
  return names;
}

const std::vector<std::string>& static_columns() {
  static const std::vector<std::string> names{"psi_d", "psi_q", "u_a", "u_b", "u_c"};
  return names;
}

const std::vector<std::string>& linear_columns() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const LinearColumn& linear : kLinearColumns) list.emplace_back(linear.name);
    return list;
  }();
  return names;
}

bool ImportMap::may_wrap() const {
  const auto angle = columns.find("theta_m");
  return angle != columns.end() && angle->second.wrap == 0 && angle->second.turns;
}

ImportMap read_import_map(const std::string& path) {
  ImportMap map;
  map.toml = read_text_file(path);
  const toml::table root = parse_toml(map.toml, path);
  for (const auto& [key, node] : root)
    if (key != "columns" && key != "time" && key != "file" && key != "axis" && key != "drive")
      throw BadInput(
          fmt::format("{}:{}: {}: unknown table; known: columns, time, file, axis, drive", path,
                      node.source().begin.line, key.str()));
  const auto* columns = table_of(path, root, "columns");
  if (!columns) throw BadInput(fmt::format("{}:1: table [columns] is missing", path));
  read_columns(path, *columns, map);
  if (const auto* time = table_of(path, root, "time")) read_time(path, *time, map);
  if (const auto* format = table_of(path, root, "file")) read_format(path, *format, map);
  if (const auto* axis = table_of(path, root, "axis")) read_axis(path, *axis, map);
  refuse_both(map);
  take_linear_columns(map);
  if (const auto* drive = table_of(path, root, "drive")) {
    MapTable table(path, "drive", *drive);
    map.preset = table.text("preset", "");
    map.preset_where = table.where(*drive);
    table.require_known();
  }
  map.time_given = map.columns.count("t") != 0;
  if (!map.time_given) map.columns["t"] = {.from = "t", .where = path + ":1"};
  return map;
}

ImportMap canonical_map(const std::vector<std::string>& header) {
  ImportMap map;
  map.columns["t"] = {.from = "t"};
  for (const auto* names : {&canonical_columns(), &static_columns()})
    for (const std::string& name : *names)
      if (std::find(header.begin(), header.end(), name) != header.end())
        map.columns[name] = {.from = name};
  const auto has = [&](const char* name) { return map.columns.count(name) != 0; };
  if (std::any_of(std::begin(kLinearColumns), std::end(kLinearColumns),
                  [&](const LinearColumn& linear) { return has(linear.rotary); }))
    return map;
  for (const std::string& name : linear_columns())
    if (std::find(header.begin(), header.end(), name) != header.end())
      map.columns[name] = {.from = name};
  take_linear_columns(map);
  return map;
}

}  // namespace twinrate

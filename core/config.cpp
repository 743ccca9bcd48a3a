#include "core/config.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "core/config_write.hpp"
#include "core/paths.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

std::string join(const std::string& prefix, std::string_view key) {
  return prefix.empty() ? std::string(key) : prefix + "." + std::string(key);
}

std::string list_names(const std::vector<std::string>& names) {
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

// The parsed file and, for each key, where it was written (a preset, the file itself, or --set).
struct Config::Impl {
  toml::table root;
  std::string source;
  std::map<std::string, std::string> origin;  // key path -> "file:line"
  std::set<std::string> read_tables;          // paths of tables some owner has read
  std::vector<std::pair<std::string, std::string>>
      owned_text;  // resolved text of read_table() tables
  DriveConfig drive;

  std::string where(const std::string& path) const {
    for (std::string p = path;; p = p.substr(0, p.rfind('.'))) {
      const auto found = origin.find(p);
      if (found != origin.end()) return found->second;
      if (p.find('.') == std::string::npos) return source;
    }
  }
  [[noreturn]] void fail(const std::string& path, const std::string& what) const {
    std::string line = fmt::format("{}: {}: {}", where(path), path, what);
    std::replace(line.begin(), line.end(), '\n', ' ');  // a quoted key may hold one
    throw BadInput(line);
  }
  void note_origins(const toml::table& table, const std::string& file, const std::string& prefix) {
    for (const auto& [key, node] : table) {
      const std::string path = join(prefix, key.str());
      origin[path] =
          file == "--set" ? "--set" : fmt::format("{}:{}", file, key.source().begin.line);
      if (const auto* sub = node.as_table()) note_origins(*sub, file, path);
      const auto* list = node.as_array();
      for (std::size_t i = 0; list && i < list->size(); ++i) {  // [[effect]]
        const toml::node& item = (*list)[i];
        if (!item.is_table()) continue;
        const std::string item_path = fmt::format("{}[{}]", path, i);
        origin[item_path] =
            file == "--set" ? "--set" : fmt::format("{}:{}", file, item.source().begin.line);
        note_origins(*item.as_table(), file, item_path);
      }
    }
  }
  // A later layer (file over preset, --set over file) wins key by key, and where it gives one of
  // two ways of saying the same thing, the other way of an earlier layer goes.
  void lay_over(const toml::table& layer) {
    static constexpr const char* kRivals[][3] = {{"rates", "n", "f_b_Hz"},
                                                 {"reference", "omega_e_rad_s", "speed_rpm"}};
    for (const auto& [section, one, other] : kRivals) {
      auto* base = root[section].as_table();
      if (!base) continue;
      if (layer[section][one]) base->erase(other);
      if (layer[section][other]) base->erase(one);
    }
    merge(root, layer);
  }
  void merge(toml::table& into, const toml::table& from) {
    for (const auto& [key, node] : from) {
      auto* sub = into[key].as_table();
      if (sub && node.is_table())
        merge(*sub, *node.as_table());
      else
        into.insert_or_assign(key, node);
    }
  }
};

namespace {

// Reads one table through a FieldVisitor and remembers which keys it asked for.
class TomlReader final : public FieldVisitor {
 public:
  TomlReader(const Config::Impl& file, const toml::table* table, std::string prefix);

  void number(const char* key, double& value, double lo, double hi, const char*,
              Presence presence) override {
    const toml::node* node = find(key, presence);
    if (node) value = number_of(*node, key, lo, hi);
  }
  void integer(const char* key, int& value, int lo, int hi, const char*,
               Presence presence) override {
    const toml::node* node = find(key, presence);
    if (!node) return;
    const std::string allowed = fmt::format("a whole number from {} to {}", lo, hi);
    if (!node->is_integer()) fail(key, "{} allowed, found {}", allowed, shown(*node));
    const std::int64_t number = node->as_integer()->get();
    if (number < lo || number > hi) fail(key, "{} is out of range, {} allowed", number, allowed);
    value = static_cast<int>(number);
  }
  void boolean(const char* key, bool& value, const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    if (!node->is_boolean()) fail(key, "true or false allowed, found {}", shown(*node));
    value = node->as_boolean()->get();
  }
  void text(const char* key, std::string& value, const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    if (!node->is_string()) fail(key, "a text in quotes allowed, found {}", shown(*node));
    value = node->as_string()->get();
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    const std::vector<std::string> allowed(names.begin(), names.end());
    const auto* text = node->as_string();
    const auto found =
        text ? std::find(allowed.begin(), allowed.end(), text->get()) : allowed.end();
    if (found == allowed.end())
      fail(key, "one of {} allowed, found {}", list_names(allowed), shown(*node));
    index = static_cast<int>(found - allowed.begin());
  }
  void numbers(const char* key, std::span<double> values, double lo, double hi,
               const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    const auto* list = node->as_array();
    if (!list || list->size() != values.size())
      fail(key, "a list of {} numbers allowed, found {}", values.size(), shown(*node));
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = number_of((*list)[i], key, lo, hi);
  }
  void profile(const char* key, Profile& value, double lo, double hi, const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    if (!node->is_array()) {
      value = Profile(number_of(*node, key, lo, hi));
      return;
    }
    std::vector<ProfileStep> steps;
    for (const toml::node& item : *node->as_array()) {
      const auto* pair = item.as_array();
      if (!pair || pair->size() != 2)
        fail(key, "a number or a list of [t_s, value] pairs allowed, found {}", shown(item));
      steps.push_back({number_of((*pair)[0], key, 0, 1e9), number_of((*pair)[1], key, lo, hi)});
      if (steps.size() > 1 && !(steps.back().t_s > steps[steps.size() - 2].t_s))
        fail(key, "times must rise, found {} after {}", steps.back().t_s,
             steps[steps.size() - 2].t_s);
    }
    if (steps.empty()) fail(key, "at least one [t_s, value] pair needed");
    value = Profile(std::move(steps));
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (node && !node->is_table()) fail(key, "a table allowed, found {}", shown(*node));
    TomlReader sub(file_, node ? node->as_table() : nullptr, join(prefix_, key));
    fields(sub);
    sub.require_known();
  }

  void accept(const std::string& key) { seen_.insert(key); }
  bool has(const char* key) const { return table_ && table_->contains(key); }
  // Keys nobody asked for. `open`: sub-tables that belong to other owners are left alone.
  void require_known(bool open_tables = false) const {
    if (!table_) return;
    for (const auto& [key, node] : *table_) {
      if (seen_.count(std::string(key.str())) || (open_tables && node.is_table())) continue;
      const std::vector<std::string> known(seen_.begin(), seen_.end());
      file_.fail(join(prefix_, key.str()), "unknown key; known here: " + list_names(known));
    }
  }

 private:
  const toml::node* find(const char* key, Presence presence) {
    seen_.insert(key);
    const toml::node* node = table_ ? table_->get(key) : nullptr;
    if (!node && presence == Presence::kRequired) fail(key, "missing key");
    return node;
  }
  double number_of(const toml::node& node, const char* key, double lo, double hi) const {
    const auto number = node.value<double>();
    if (!number || !node.is_number())
      fail(key, "a number from {} to {} allowed, found {}", lo, hi, shown(node));
    if (!(*number >= lo && *number <= hi))
      fail(key, "{} is out of range, {} to {} allowed", *number, lo, hi);
    return *number;
  }
  static std::string shown(const toml::node& node) {
    std::ostringstream out;
    node.visit([&](const auto& n) { out << n; });
    std::string text = out.str();
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text.size() > 60 ? text.substr(0, 57) + "..." : text;
  }
  template <class... Args>
  [[noreturn]] void fail(const char* key, fmt::format_string<Args...> text, Args&&... args) const {
    file_.fail(join(prefix_, key), fmt::format(text, std::forward<Args>(args)...));
  }

  const Config::Impl& file_;
  const toml::table* table_;
  std::string prefix_;
  std::set<std::string> seen_;
};

TomlReader::TomlReader(const Config::Impl& file, const toml::table* table, std::string prefix)
    : file_(file), table_(table), prefix_(std::move(prefix)) {}

void read_effects(const Config::Impl& file, DriveConfig& drive) {
  const toml::node* node = file.root.get("effect");
  if (!node) return;
  const auto* list = node->as_array();
  if (!list) file.fail("effect", "write each effect as its own [[effect]] table");
  for (std::size_t i = 0; i < list->size(); ++i) {
    const auto* table = (*list)[i].as_table();
    const std::string path = fmt::format("effect[{}]", i);
    if (!table) file.fail("effect", "write each effect as its own [[effect]] table");
    const auto kind = (*table)["kind"].value<std::string>();
    if (!kind)
      file.fail(path + ".kind", "missing key, one of " + list_names(effect_kinds()) + " allowed");
    const auto effect = make_effect(*kind);
    if (!effect)
      file.fail(path + ".kind",
                fmt::format("one of {} allowed, found {}", list_names(effect_kinds()), *kind));
    TomlReader reader(file, table, path);
    reader.accept("kind");
    effect->fields(reader);
    reader.require_known();
    drive.effects.push_back(effect);
  }
}

void check_across(const Config::Impl& file, DriveConfig& drive) {
  RateParameters& rates = drive.rates;
  if (rates.f_b_Hz > 0) {
    const double ratio = rates.f_s_Hz / rates.f_b_Hz;
    const double n = std::round(ratio);
    if (n < 1 || std::abs(ratio - n) > 2e-3 * n)
      file.fail("rates.f_b_Hz", fmt::format("f_s/f_b = {} is not a whole number; nearest: {} Hz",
                                            ratio, rates.f_s_Hz / std::max(1.0, n)));
    if (file.root["rates"]["n"] && rates.n != static_cast<int>(n))
      file.fail("rates.f_b_Hz",
                fmt::format("gives n = {}, but rates.n = {} is given too", n, rates.n));
    rates.n = static_cast<int>(n);
  }
  rates.f_b_Hz = rates.f_s_Hz / rates.n;
  if (drive.run.settle_s >= drive.run.duration_s) drive.run.settle_s = 0.25 * drive.run.duration_s;
}

template <class Section>
void read_section(TomlReader& root, const char* key, Section& section) {
  root.table(key, [&](FieldVisitor& f) { section.fields(f); });
}

void read_drive(Config::Impl& file) {
  DriveConfig& d = file.drive;
  TomlReader root(file, &file.root, "");
  root.text("name", d.name, "");
  choice(root, "start", d.start, kStartNames, "");
  read_section(root, "machine", d.machine);
  read_section(root, "inverter", d.inverter);
  read_section(root, "sensors", d.sensors);
  read_section(root, "rates", d.rates);
  read_section(root, "gain", d.gain);
  read_section(root, "plant", d.plant);
  read_section(root, "load", d.load);
  read_section(root, "run", d.run);
  read_section(root, "bus", d.bus);
  read_section(root, "reference", d.reference);
  if (const auto* table = file.root["reference"].as_table()) {
    d.reference.in_rpm = table->contains("speed_rpm");
    if (d.reference.in_rpm && table->contains("omega_e_rad_s"))
      file.fail("reference.speed_rpm", "give either speed_rpm or omega_e_rad_s, not both");
  }
  for (const char* key : {"estimator", "controller"}) {
    root.accept(key);
    const auto* table = file.root[key].as_table();
    if (file.root.contains(key) && !table) file.fail(key, "a table allowed");
    TomlReader reader(file, table, key);
    if (std::string_view(key) == "estimator")
      d.estimator.fields(reader);
    else
      d.controller.fields(reader);
    reader.require_known(true);
  }
  root.accept("effect");
  root.accept("preset");
  root.require_known();
  read_effects(file, d);
  check_across(file, d);
}

toml::table parse_text(const std::string& text, const std::string& source) {
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw BadInput(
        fmt::format("{}:{}: {}", source, error.source().begin.line, error.description()));
  }
}

std::string read_file(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw BadInput(fmt::format("{}: cannot be read", path));
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string preset_path(const std::string& name, const std::string& said_at) {
  const fs::path path = fs::path(preset_directory()) / (name + ".toml");
  if (!fs::is_regular_file(path))
    throw BadInput(fmt::format("{}: no such file and no such preset; presets: {}", said_at,
                               list_names(preset_names())));
  return path.string();
}

toml::table parse_override(const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw BadInput(fmt::format("--set {}: write key.path=value", text));
  const std::string key = text.substr(0, equals), value = text.substr(equals + 1);
  try {
    return toml::parse(key + " = " + value);
  } catch (const toml::parse_error&) {
  }
  try {  // a bare word is a text
    return toml::parse(key + " = \"" + value + "\"");
  } catch (const toml::parse_error& error) {
    throw BadInput(fmt::format("--set {}: {}", text, error.description()));
  }
}

}  // namespace

Config::Config() : impl_(std::make_unique<Impl>()) {}
Config::Config(Config&&) noexcept = default;
Config& Config::operator=(Config&&) noexcept = default;
Config::~Config() = default;

Config Config::load(const std::string& name_or_path, const std::vector<std::string>& overrides) {
  const bool is_file = fs::is_regular_file(name_or_path);
  const std::string path = is_file ? name_or_path : preset_path(name_or_path, name_or_path);
  return parse(read_file(path), path, overrides);
}

Config Config::parse(const std::string& toml_text, const std::string& source_name,
                     const std::vector<std::string>& overrides) {
  Config config;
  Impl& file = *config.impl_;
  file.source = source_name;
  const toml::table own = parse_text(toml_text, source_name);
  if (own.contains("preset") && !own["preset"].is_string())
    throw BadInput(fmt::format("{}:{}: preset: the name of a preset in quotes allowed", source_name,
                               own["preset"].node()->source().begin.line));
  if (const auto preset = own["preset"].value<std::string>()) {
    const std::string path = preset_path(*preset, source_name + ": preset = \"" + *preset + "\"");
    const toml::table base = parse_text(read_file(path), path);
    file.note_origins(base, path, "");
    file.merge(file.root, base);
  }
  file.note_origins(own, source_name, "");
  file.lay_over(own);
  for (const std::string& text : overrides) {
    const toml::table table = parse_override(text);
    file.note_origins(table, "--set", "");
    file.lay_over(table);
  }
  read_drive(file);
  return config;
}

const DriveConfig& Config::drive() const {
  return impl_->drive;
}
std::string Config::where(const std::string& key_path) const {
  return impl_->where(key_path);
}

void Config::read_table(const std::string& path, const std::function<void(FieldVisitor&)>& fields) {
  const toml::node* node = impl_->root.at_path(path).node();
  if (node && !node->is_table()) impl_->fail(path, "a table allowed");
  TomlReader reader(*impl_, node ? node->as_table() : nullptr, path);
  fields(reader);
  reader.require_known();
  impl_->read_tables.insert(path);
  auto& owned = impl_->owned_text;
  std::erase_if(owned, [&](const auto& entry) { return entry.first == path; });
  owned.emplace_back(path, write_table(path, fields));
}

bool Config::has_table(const std::string& path) const {
  return impl_->root.at_path(path).is_table();
}

void Config::require_all_read() const {
  for (const char* key : {"estimator", "controller"}) {
    const auto* table = impl_->root[key].as_table();
    if (!table) continue;
    for (const auto& [sub, node] : *table) {
      const std::string path = join(key, sub.str());
      if (!node.is_table() || impl_->read_tables.count(path)) continue;
      std::vector<std::string> known(impl_->read_tables.begin(), impl_->read_tables.end());
      impl_->fail(path, "unknown table; known: " + list_names(known));
    }
  }
}

std::string Config::resolved() const {
  std::string text = write_drive(impl_->drive);
  for (const auto& [path, table_text] : impl_->owned_text) text += table_text;
  return text + write_effects(impl_->drive);
}

std::string Config::merged() const {
  std::ostringstream text;
  text << impl_->root << "\n";
  return text.str();
}

std::int64_t Config::fingerprint() const {
  std::uint64_t hash = 0;
  for (unsigned char c : merged()) hash = splitmix64(hash ^ c);
  return static_cast<std::int64_t>(hash);
}

std::string preset_directory() {
  return data_directory() + "/config";
}

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(preset_directory(), error))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace twinrate

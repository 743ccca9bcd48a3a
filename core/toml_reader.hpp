// The inside of core/config: the parsed file with the origin of each key, and the reader that walks
// a field list. Only core/config.cpp includes it; everybody else sees Config.
#pragma once
#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "core/config.hpp"
#include "core/report_error.hpp"

namespace twinrate {

inline std::string join(const std::string& prefix, std::string_view key) {
  return prefix.empty() ? std::string(key) : prefix + "." + std::string(key);
}

inline std::string list_names(const std::vector<std::string>& names) {
  return fmt::format("{}", fmt::join(names, ", "));
}

// Names, kinds and paths: PATH_MAX of Linux.
inline constexpr std::size_t kMaxTextBytes = 4096;

// Tables that other folders own as a whole; DriveConfig reads the common keys of [plant].
inline constexpr const char* kOwnedTables[] = {"plant",   "safety",   "bus",     "logger",
                                               "monitor", "realtime", "steering"};

// The parsed file and the place where each key was written (a preset, the file itself, or --set).
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
    throw BadInput(printable(fmt::format("{}: {}: {}", where(path), path, what)));
  }
  // Requires that an existing table was read by its owner.
  void require_read(const std::string& path) const {
    if (read_tables.count(path)) return;
    std::vector<std::string> known;
    for (const std::string& table : read_tables)
      if (table.find('.') != std::string::npos) known.push_back(table);
    fail(path, "unknown table; known: " + list_names(known));
  }
  // As its owner resolved it; as given if the owner has not read it.
  std::string owned_table_text(const std::string& path) const {
    for (const auto& [owned, text] : owned_text)
      if (owned == path) return text;
    const auto* table = root[path].as_table();
    return table ? given_text(path, *table) : "";
  }
  // With the headers of its own tables at their whole path.
  static std::string given_text(const std::string& path, const toml::table& table) {
    toml::table keys;
    std::string nested;
    for (const auto& [key, node] : table) {
      if (const auto* sub = node.as_table())
        nested += given_text(join(path, key.str()), *sub);
      else
        keys.insert(key, node);
    }
    std::ostringstream text;
    text << "\n[" << path << "]\n" << keys << "\n";
    return text.str() + nested;
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
  // A later layer (file over preset, --set over file) wins key by key. If it gives one of two
  // equivalent keys, the other one of an earlier layer is removed. All of --set is one layer: there
  // both keys stay, and reading them refuses a contradiction.
  void lay_over(const toml::table& layer) {
    static constexpr const char* kRivals[][3] = {{"rates", "n", "f_b_Hz"},
                                                 {"reference", "omega_e_rad_s", "speed_rpm"}};
    for (const auto& [section, one, other] : kRivals) {
      auto* base = root[section].as_table();
      if (!base) continue;
      if (layer[section][one] && !is_set(section, other)) base->erase(other);
      if (layer[section][other] && !is_set(section, one)) base->erase(one);
    }
    merge(root, layer);
  }
  bool is_set(const char* section, const char* key) const {
    const auto found = origin.find(join(section, key));
    return found != origin.end() && found->second == "--set";
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

// Reads one table through a FieldVisitor and remembers the requested keys.
class TomlReader final : public FieldVisitor {
 public:
  TomlReader(const Config::Impl& file, const toml::table* table, std::string prefix)
      : file_(file), table_(table), prefix_(std::move(prefix)) {}

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
    const std::string& text = node->as_string()->get();
    if (text.size() > kMaxTextBytes || printable(text) != text)
      fail(key, "a text of one line and at most {} bytes allowed, found {}", kMaxTextBytes,
           shown(*node));
    value = text;
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (node) index = position(key, *node, names);
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
  void integers(const char* key, std::vector<int>& values, int lo, int hi, std::size_t most,
                const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    const auto* list = node->as_array();
    const std::string allowed =
        fmt::format("a list of at most {} whole numbers from {} to {}", most, lo, hi);
    if (!list || list->size() > most) fail(key, "{} allowed, found {}", allowed, shown(*node));
    values.clear();
    for (const toml::node& item : *list) {
      const auto number = item.is_integer() ? item.as_integer()->get() : std::int64_t{lo} - 1;
      if (number < lo || number > hi) fail(key, "{} allowed, found {}", allowed, shown(item));
      values.push_back(static_cast<int>(number));
    }
  }
  void profile(const char* key, Profile& value, double lo, double hi, const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    if (!node->is_array()) {
      value = Profile(number_of(*node, key, lo, hi));
      return;
    }
    value = profile_of(*node->as_array(), key,
                       [&](const toml::node& item) { return number_of(item, key, lo, hi); });
  }
  void choice_profile(const char* key, Profile& indices, std::span<const char* const> names,
                      const char*) override {
    const toml::node* node = find(key, Presence::kOptional);
    if (!node) return;
    if (!node->is_array()) {
      indices = Profile(static_cast<double>(position(key, *node, names)));
      return;
    }
    indices = profile_of(*node->as_array(), key, [&](const toml::node& item) {
      return static_cast<double>(position(key, item, names));
    });
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    TomlReader sub(file_, unread_table(key), join(prefix_, key));
    fields(sub);
    sub.require_known();
  }
  // A table whose keys this reader does not read; null if there is none.
  const toml::table* unread_table(const char* key) {
    const toml::node* node = find(key, Presence::kOptional);
    if (node && !node->is_table()) fail(key, "a table allowed, found {}", shown(*node));
    return node ? node->as_table() : nullptr;
  }

  void accept(const std::string& key) { seen_.insert(key); }
  bool has(const char* key) const { return table_ && table_->contains(key); }
  // Refuses keys that were not requested. `open`: sub-tables of other owners are skipped.
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
  int position(const char* key, const toml::node& node, std::span<const char* const> names) const {
    const std::vector<std::string> allowed(names.begin(), names.end());
    const auto* text = node.as_string();
    const auto found =
        text ? std::find(allowed.begin(), allowed.end(), text->get()) : allowed.end();
    if (found == allowed.end())
      fail(key, "one of {} allowed, found {}", list_names(allowed), shown(node));
    return static_cast<int>(found - allowed.begin());
  }
  template <class ValueOf>
  Profile profile_of(const toml::array& list, const char* key, const ValueOf& value_of) const {
    std::vector<ProfileStep> steps;
    for (const toml::node& item : list) {
      const auto* pair = item.as_array();
      if (!pair || pair->size() != 2)
        fail(key, "a single value or a list of [t_s, value] pairs allowed, found {}", shown(item));
      steps.push_back({number_of((*pair)[0], key, 0, 1e9), value_of((*pair)[1])});
      if (steps.size() > 1 && !(steps.back().t_s > steps[steps.size() - 2].t_s))
        fail(key, "times must rise, found {} after {}", steps.back().t_s,
             steps[steps.size() - 2].t_s);
    }
    if (steps.empty()) fail(key, "at least one [t_s, value] pair needed");
    return Profile(std::move(steps));
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

}  // namespace twinrate

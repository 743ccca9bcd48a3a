#include "core/config_write.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "core/config.hpp"

namespace twinrate {
namespace {

// Shortest text that reads back to the same double, always with a point or exponent.
std::string number_text(double value) {
  std::string text = fmt::format("{}", value);
  if (text.find_first_of(".eni") == std::string::npos) text += ".0";
  return text;
}

// For steering.n, policy and emergency, a single step also has a time.
bool is_one_value(const Profile& profile) {
  return profile.is_constant() && profile.steps().front().t_s == 0;
}

std::string profile_text(const Profile& profile) {
  if (is_one_value(profile)) return number_text(profile.steps().front().value);
  std::string text;
  for (const ProfileStep& step : profile.steps())
    text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", number_text(step.t_s),
                        number_text(step.value));
  return "[" + text + "]";
}

std::string name_text(const Profile& indices, std::span<const char* const> names) {
  const auto name = [&](double index) {
    return fmt::format("\"{}\"", names[static_cast<std::size_t>(index)]);
  };
  if (is_one_value(indices)) return name(indices.at(0));
  std::string text;
  for (const ProfileStep& step : indices.steps())
    text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", number_text(step.t_s),
                        name(step.value));
  return "[" + text + "]";
}

std::string list_text(std::span<const double> values) {
  std::string text;
  for (double value : values) text += (text.empty() ? "" : ", ") + number_text(value);
  return "[" + text + "]";
}

std::string list_text(const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += (text.empty() ? "" : ", ") + std::to_string(value);
  return "[" + text + "]";
}

// A TOML basic string.
std::string text_text(const std::string& value) {
  std::string text = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') text += '\\';
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      text += fmt::format("\\u{:04x}", static_cast<int>(c));
    else
      text += c;
  }
  return text + "\"";
}

// One row a key; sub-tables come after the keys of their parent.
class RowCollector final : public FieldVisitor {
 public:
  RowCollector(std::vector<KeyRow>& rows, std::string prefix)
      : rows_(rows), prefix_(std::move(prefix)) {}

  void number(const char* key, double& value, double lo, double hi, const char* meaning,
              Presence presence) override {
    add(key, fmt::format("{} to {}", lo, hi),
        presence == Presence::kRequired ? "" : number_text(value), meaning);
  }
  void integer(const char* key, int& value, int lo, int hi, const char* meaning,
               Presence presence) override {
    add(key, fmt::format("whole, {} to {}", lo, hi),
        presence == Presence::kRequired ? "" : std::to_string(value), meaning);
  }
  void boolean(const char* key, bool& value, const char* meaning) override {
    add(key, "true, false", value ? "true" : "false", meaning);
  }
  void text(const char* key, std::string& value, const char* meaning) override {
    add(key, "text", text_text(value), meaning);
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char* meaning) override {
    add(key, fmt::format("{}", fmt::join(names, ", ")),
        fmt::format("\"{}\"", names[static_cast<std::size_t>(index)]), meaning);
  }
  void numbers(const char* key, std::span<double> values, double lo, double hi,
               const char* meaning) override {
    add(key, fmt::format("{} numbers, {} to {}", values.size(), lo, hi), list_text(values),
        meaning);
  }
  void integers(const char* key, std::vector<int>& values, int lo, int hi, std::size_t most,
                const char* meaning) override {
    add(key, fmt::format("up to {} whole numbers, {} to {}", most, lo, hi), list_text(values),
        meaning);
  }
  void profile(const char* key, Profile& value, double lo, double hi,
               const char* meaning) override {
    add(key, fmt::format("number or [[t_s, value], ..], {} to {}", lo, hi), profile_text(value),
        meaning);
  }
  void choice_profile(const char* key, Profile& indices, std::span<const char* const> names,
                      const char* meaning) override {
    add(key, fmt::format("{}; or [[t_s, name], ..]", fmt::join(names, ", ")),
        name_text(indices, names), meaning);
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    std::vector<KeyRow> rows;
    RowCollector sub(rows, prefix_ + "." + key);
    fields(sub);
    sub.finish();
    later_.insert(later_.end(), rows.begin(), rows.end());
  }
  void finish() { rows_.insert(rows_.end(), later_.begin(), later_.end()); }

 private:
  void add(const char* key, std::string range, std::string value, const char* meaning) {
    rows_.push_back({prefix_ + "." + key, std::move(range), std::move(value), meaning});
  }
  std::vector<KeyRow>& rows_;
  std::string prefix_;
  std::vector<KeyRow> later_;
};

// Writes the present values; nested tables follow their parent under their own header.
class TomlWriter final : public FieldVisitor {
 public:
  explicit TomlWriter(std::string path) : path_(std::move(path)) {}

  void number(const char* key, double& value, double, double, const char*, Presence) override {
    line(key, number_text(value));
  }
  void integer(const char* key, int& value, int, int, const char*, Presence) override {
    line(key, std::to_string(value));
  }
  void boolean(const char* key, bool& value, const char*) override {
    line(key, value ? "true" : "false");
  }
  void text(const char* key, std::string& value, const char*) override {
    line(key, text_text(value));
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char*) override {
    line(key, fmt::format("\"{}\"", names[static_cast<std::size_t>(index)]));
  }
  void numbers(const char* key, std::span<double> values, double, double, const char*) override {
    line(key, list_text(values));
  }
  void integers(const char* key, std::vector<int>& values, int, int, std::size_t,
                const char*) override {
    line(key, list_text(values));
  }
  void profile(const char* key, Profile& value, double, double, const char*) override {
    line(key, profile_text(value));
  }
  void choice_profile(const char* key, Profile& indices, std::span<const char* const> names,
                      const char*) override {
    line(key, name_text(indices, names));
  }
  void table(const char* key, const std::function<void(FieldVisitor&)>& fields) override {
    nested_ += write_table(path_ + "." + key, fields);
  }
  std::string text() const { return lines_ + nested_; }

 private:
  void line(const char* key, const std::string& value) {
    lines_ += fmt::format("{} = {}\n", key, value);
  }
  std::string path_, lines_, nested_;
};

template <class Section>
std::string section_text(const char* key, Section section) {
  return write_table(key, [&](FieldVisitor& f) { section.fields(f); });
}

// A drive file gives n or f_b_Hz and one of two speeds; the resolved file keeps the form that
// cannot conflict.
std::string without_line(std::string text, const std::string& key) {
  const auto begin = text.find("\n" + key + " = ");
  if (begin == std::string::npos) return text;
  return text.erase(begin + 1, text.find('\n', begin + 1) - begin);
}

}  // namespace

std::string write_table(const std::string& path, const std::function<void(FieldVisitor&)>& fields) {
  TomlWriter writer(path);
  fields(writer);
  return fmt::format("\n[{}]\n{}", path, writer.text());
}

std::string write_drive(const DriveConfig& d,
                        const std::function<std::string(const char*)>& owned) {
  std::string text = fmt::format("{}\nname = {}\nstart = \"{}\"\n", kResolvedMark,
                                 text_text(d.name), kStartNames[static_cast<int>(d.start)]);
  text += section_text("machine", d.machine) + section_text("inverter", d.inverter) +
          section_text("sensors", d.sensors);
  text += without_line(section_text("rates", d.rates), "f_b_Hz");
  text += section_text("gain", d.gain) + owned("plant");
  text += without_line(section_text("reference", d.reference),
                       d.reference.in_rpm ? "omega_e_rad_s" : "speed_rpm");
  return text + section_text("load", d.load) + section_text("run", d.run) + owned("safety") +
         owned("bus") + owned("logger") + owned("realtime") + owned("monitor") + owned("bridge") +
         owned("steering") + section_text("estimator", d.estimator) +
         section_text("controller", d.controller);
}

std::string write_effects(const DriveConfig& drive) {
  std::string text;
  for (const ConfiguredEffect& configured : drive.effects) {
    const auto& [effect, used_in, from_s, known_from_s, known_to_s] = configured;
    // fields() only shows the values to the writer; the copy keeps the config itself constant.
    const auto copy = effect->clone();
    TomlWriter writer("effect");
    copy->fields(writer);
    std::string times;
    if (from_s > 0) times += "from_s = " + number_text(from_s) + "\n";
    if (known_from_s > 0) times += "known_from_s = " + number_text(known_from_s) + "\n";
    if (std::isfinite(known_to_s)) times += "known_to_s = " + number_text(known_to_s) + "\n";
    text += fmt::format("\n[[effect]]\nkind = \"{}\"\nused_in = \"{}\"\n{}", effect->kind(),
                        kUsedInNames[static_cast<int>(used_in)], times + writer.text());
  }
  return text;
}

std::vector<KeyRow> describe_keys(const std::string& prefix,
                                  const std::function<void(FieldVisitor&)>& fields) {
  std::vector<KeyRow> rows;
  RowCollector collector(rows, prefix);
  fields(collector);
  collector.finish();
  return rows;
}

std::vector<KeyRow> describe_drive_keys(const std::vector<OwnedTable>& owned) {
  DriveConfig d;
  std::vector<KeyRow> rows{
      {"name", "text", "\"\"", "name of the drive, for titles"},
      {"preset", "name of a preset", "", "start from this preset; the keys of this file win"},
      {"start", fmt::format("{}", fmt::join(kStartNames, ", ")), "\"aligned\"",
       "aligned: the rotor starts at angle 0; align_if: alignment, I/f ramp, hand-over; flying: at "
       "the "
       "reference speed on the true angle"}};
  const auto append = [&](std::vector<KeyRow> more) {
    std::move(more.begin(), more.end(), std::back_inserter(rows));
  };
  const auto add = [&](const char* prefix, auto& section) {
    append(describe_keys(prefix, [&](FieldVisitor& f) { section.fields(f); }));
  };
  const auto add_owned = [&](std::string_view path) {
    for (const OwnedTable& table : owned)
      if (table.path == path) append(describe_keys(table.path, table.fields));
  };
  add("machine", d.machine);
  add("inverter", d.inverter);
  add("sensors", d.sensors);
  add("rates", d.rates);
  add("gain", d.gain);
  add_owned("plant");
  add("reference", d.reference);
  add("load", d.load);
  add("run", d.run);
  add_owned("safety");
  add_owned("bus");
  add_owned("logger");
  add_owned("realtime");
  add_owned("monitor");
  add_owned("bridge");
  add_owned("steering");
  add("estimator", d.estimator);
  add("controller", d.controller);
  return rows;
}

}  // namespace twinrate

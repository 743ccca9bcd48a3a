#include "core/config.hpp"

#include <cmath>
#include <filesystem>

#include "core/config_write.hpp"
#include "core/message_check.hpp"
#include "core/paths.hpp"
#include "core/toml_reader.hpp"
#include "core/toml_text.hpp"
#include "model/effects/delayed.hpp"
#include "model/effects/flux_map.hpp"
#include "model/effects/losses.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

void check_effect(const Config::Impl& file, const std::string& path, const DriveConfig& drive,
                  Effect& effect, double from_s) {
  const std::string kind(effect.kind());
  if (const std::string lacking = effect.prepare(drive.facts()); !lacking.empty())
    file.fail(path, kind + ": " + lacking);
  if (const std::string why = why_not_delayed(effect); from_s > 0 && !why.empty())
    file.fail(path + ".from_s", fmt::format("{}: {}, 0 allowed", kind, why));
  if (LegFacts legs;
      from_s > 0 && drive.plant.inverter == InverterModel::kSwitched && effect.describe_legs(legs))
    file.fail(path + ".from_s", kind + ": the switched inverter has it throughout a run");
}

// `drive` null: the tables as given, independent of a drive.
std::vector<ConfiguredEffect> read_effects(const Config::Impl& file, const DriveConfig* drive) {
  std::vector<ConfiguredEffect> effects;
  const toml::node* node = file.root.get("effect");
  if (!node) return effects;
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
    UsedIn used_in = UsedIn::kPlant;
    FieldVisitor& f = reader;
    f.choice("used_in", used_in, kUsedInNames, "");
    double from_s = 0;
    reader.number("from_s", from_s, 0, 1e6, "", Presence::kOptional);
    ConfiguredEffect configured{effect, used_in};
    reader.number("known_from_s", configured.known_from_s, 0, 1e6, "", Presence::kOptional);
    reader.number("known_to_s", configured.known_to_s, 0, 1e6, "", Presence::kOptional);
    effect->fields(reader);
    reader.require_known();
    if (drive) check_effect(file, path, *drive, *effect, from_s);
    configured.from_s = from_s;
    if (configured.known_to_s <= configured.known_from_s)
      file.fail(path + ".known_to_s", "a time after known_from_s allowed");
    if (used_in == UsedIn::kPlant &&
        (configured.known_from_s > 0 || std::isfinite(configured.known_to_s)))
      file.fail(path + ".used_in",
                "known_from_s and known_to_s are of the model: \"model\" or \"both\" allowed");
    effects.push_back(configured);
  }
  return effects;
}

// Effects on the flux: together they must leave a machine whose current answers its voltage,
// up to the rated one along each axis.
void check_flux(const Config::Impl& file, const DriveConfig& drive) {
  for (const Effects& effects : {drive.plant_effects(), drive.model_effects()}) {
    const Effects on_flux = acting_on(effects, kOnFlux);
    if (on_flux.empty()) continue;
    if (drive.plant.saliency != Saliency::kRotor)
      file.fail("plant.saliency", "fixed_axes has no place for effects on the flux, found " +
                                      std::string(on_flux[0]->kind()));
    for (const double d : {-1, 0, 1})
      for (const double q : {-1, 0, 1}) {
        const Vec2 i_dq = drive.machine.i_rated * Vec2(d, q);
        const Eigen::Matrix2d L =
            incremental_inductance(drive.machine, flux_map(on_flux, {.i_dq = i_dq}));
        if (L(0, 0) <= 0 || L.determinant() <= 0)
          file.fail("effect", fmt::format("the effects on the flux together leave no inductance at "
                                          "i_d = {:g} A, i_q = {:g} A",
                                          i_dq[0], i_dq[1]));
      }
  }
}

// An effect below zero may reduce a value that is declared too large, but no loss may become a
// gain.
void check_losses(const Config::Impl& file, const DriveConfig& drive) {
  for (const Effects& effects : {drive.plant_effects(), drive.model_effects()})
    if (const std::string what = negative_loss(effects, drive.machine); !what.empty())
      file.fail("effect", what);
}

// A drive has one shaft, and a signal passes one filter: the sum of two would be neither.
void check_shaft_and_filters(const Config::Impl& file, const Effects& effects) {
  int shafts = 0;
  SamplingFacts all;
  for (const auto& effect : effects) {
    ShaftFacts shaft;
    shafts += effect->describe_shaft(shaft);
    if (shafts > 1)
      file.fail("effect",
                fmt::format("{}: the drive has a torsion or backlash already", effect->kind()));
    SamplingFacts own;
    effect->describe_sampling(own);
    for (int signal = 0; signal < 4; ++signal) {
      if (own.lowpass[signal] > 0 && all.lowpass[signal] > 0)
        file.fail("effect", "signal_lag: one first_order filter a signal");
      all.lowpass[signal] += own.lowpass[signal];
    }
  }
}

// Each effect beside all the others.
void check_effects(const Config::Impl& file, const DriveConfig& drive) {
  check_shaft_and_filters(file, drive.plant_effects());
  check_shaft_and_filters(file, drive.model_effects());
  check_flux(file, drive);
  check_losses(file, drive);
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
  if (drive.plant.inverter == InverterModel::kSwitched) {
    const double f_pwm = drive.facts().f_pwm, periods = f_pwm / rates.f_s_Hz;
    if (std::round(periods) < 1 || std::abs(periods - std::round(periods)) > 1e-9 * periods)
      file.fail("plant.inverter",
                fmt::format("switched needs a whole number of switching periods a tick: "
                            "inverter.f_pwm_Hz = {}, rates.f_s_Hz = {}",
                            f_pwm, rates.f_s_Hz));
  }
  if (drive.run.settle_s >= drive.run.duration_s) drive.run.settle_s = 0.25 * drive.run.duration_s;
}

template <class Section>
void read_section(TomlReader& root, const char* key, Section& section) {
  root.table(key, [&](FieldVisitor& f) { section.fields(f); });
}

// Its sub-tables belong to the kinds of filter or controller.
template <class Section>
void read_choice_of_kind(const Config::Impl& file, TomlReader& root, const char* key,
                         Section& section) {
  root.accept(key);
  const auto* table = file.root[key].as_table();
  if (file.root.contains(key) && !table) file.fail(key, "a table allowed");
  TomlReader reader(file, table, key);
  section.fields(reader);
  reader.require_known(true);
}

void read_reference(const Config::Impl& file, TomlReader& root, ReferenceParameters& reference) {
  read_section(root, "reference", reference);
  const auto* table = file.root["reference"].as_table();
  if (!table) return;
  reference.in_rpm = table->contains("speed_rpm");
  if (reference.in_rpm && table->contains("omega_e_rad_s"))
    file.fail("reference.speed_rpm", "give either speed_rpm or omega_e_rad_s, not both");
}

void read_drive(Config::Impl& file) {
  DriveConfig& d = file.drive;
  TomlReader root(file, &file.root, "");
  FieldVisitor& f = root;
  f.text("name", d.name, "");
  f.choice("start", d.start, kStartNames, "");
  read_section(root, "machine", d.machine);
  read_section(root, "inverter", d.inverter);
  read_section(root, "sensors", d.sensors);
  read_section(root, "rates", d.rates);
  read_section(root, "gain", d.gain);
  TomlReader plant(file, root.unread_table("plant"), "plant");
  d.plant.fields(plant);
  read_section(root, "load", d.load);
  read_section(root, "run", d.run);
  root.unread_table("bus");
  root.unread_table("monitor");
  root.unread_table("bridge");
  root.unread_table("safety");
  root.unread_table("logger");
  root.unread_table("realtime");
  root.unread_table("steering");
  read_reference(file, root, d.reference);
  read_choice_of_kind(file, root, "estimator", d.estimator);
  read_choice_of_kind(file, root, "controller", d.controller);
  root.accept("effect");
  root.accept("preset");
  root.require_known();
  d.effects = read_effects(file, &d);
  check_effects(file, d);
  check_across(file, d);
}

// By its name, or by its file in the tree: config/NAME.toml.
std::string preset_path(const std::string& name, const std::string& said_at) {
  const fs::path file(name);
  const bool of_tree = file.parent_path() == "config" && file.extension() == ".toml";
  const fs::path path =
      fs::path(preset_directory()) / (of_tree ? file.filename().string() : name + ".toml");
  std::error_code unusable;
  if (fs::is_regular_file(path, unusable)) return path.string();
  if (fs::is_directory(file, unusable))
    throw BadInput(fmt::format("{}: is a directory; a drive file or the name of a preset allowed",
                               printable(said_at)));
  throw BadInput(fmt::format("{}: no such file and no such preset; presets: {}", printable(said_at),
                             list_names(preset_names())));
}

toml::table parse_override(const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw BadInput(fmt::format("--set {}: write key.path=value", text));
  const std::string key = text.substr(0, equals), value = text.substr(equals + 1);
  try {
    return parse_toml(key + " = " + value, "--set");
  } catch (const BadInput&) {
  }
  try {  // a bare word is a text
    return parse_toml(key + " = \"" + value + "\"", "--set");
  } catch (const BadInput& error) {
    throw BadInput(fmt::format("--set {}: {}", text, error.what()));
  }
}

// A text of [[effect]] tables and nothing else.
void read_effects_only(const std::string& effects_toml, const std::string& source,
                       Config::Impl& file) {
  file.source = source;
  if (effects_toml.size() > kMaxRequestText)
    throw BadInput(fmt::format("{}: at most {} bytes allowed", source, kMaxRequestText));
  file.root = parse_toml(effects_toml, source);
  file.note_origins(file.root, source, "");
  for (const auto& [key, node] : file.root)
    if (key.str() != "effect") file.fail(std::string(key.str()), "only [[effect]] tables allowed");
}

std::vector<ConfiguredEffect> read_effects_in(const std::string& effects_toml,
                                              const std::string& source) {
  Config::Impl file;
  read_effects_only(effects_toml, source, file);
  return read_effects(file, nullptr);
}

// Checks an extension of a model. `drive` as in read_effects.
void check_addition_to(const DriveConfig* drive, const std::string& effects_toml,
                       const std::string& source) {
  Config::Impl file;
  read_effects_only(effects_toml, source, file);
  const std::vector<ConfiguredEffect> effects = read_effects(file, drive);
  if (std::all_of(effects.begin(), effects.end(),
                  [](const auto& e) { return e.used_in == UsedIn::kPlant; }))
    throw BadInput(source + ": no effect with used_in = \"model\" or \"both\" in it");
  if (!drive) return;
  DriveConfig extended = *drive;
  extended.effects.insert(extended.effects.end(), effects.begin(), effects.end());
  check_effects(file, extended);
}

}  // namespace

Config::Config() : impl_(std::make_unique<Impl>()) {}
Config::Config(Config&&) noexcept = default;
Config& Config::operator=(Config&&) noexcept = default;
Config::~Config() = default;

Config Config::load(const std::string& name_or_path, const std::vector<std::string>& overrides) {
  std::error_code unusable;
  const bool is_file = fs::is_regular_file(name_or_path, unusable);
  if (!is_file && fs::exists(name_or_path, unusable) && name_or_path.find('/') != std::string::npos)
    throw BadInput(
        fmt::format("{}: is not a plain file; a drive file or the name of a preset allowed",
                    printable(name_or_path)));
  const std::string path = is_file ? name_or_path : preset_path(name_or_path, name_or_path);
  return parse(read_text_file(path), path, overrides);
}

Config Config::parse(const std::string& toml_text, const std::string& source_name,
                     const std::vector<std::string>& overrides) {
  Config config;
  Impl& file = *config.impl_;
  file.source = source_name;
  const toml::table own = parse_toml(toml_text, source_name);
  if (own.contains("preset") && !own["preset"].is_string())
    throw BadInput(fmt::format("{}:{}: preset: the name of a preset in quotes allowed", source_name,
                               own["preset"].node()->source().begin.line));
  if (const auto preset = own["preset"].value<std::string>()) {
    const std::string path = preset_path(*preset, source_name + ": preset = \"" + *preset + "\"");
    const toml::table base = parse_toml(read_text_file(path), path);
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
  const auto known = std::find_if(owned.begin(), owned.end(),
                                  [&](const auto& entry) { return entry.first == path; });
  // The second call of `fields` writes. A function that sets a value restores the read one here.
  const std::string text = write_table(path, fields);
  if (known != owned.end())
    known->second = text;  // read again: it keeps its place
  else
    owned.emplace_back(path, text);
}

std::optional<double> Config::given_number(const std::string& key_path) const {
  return impl_->root.at_path(key_path).value<double>();
}

bool Config::has_table(const std::string& path) const {
  return impl_->root.at_path(path).is_table();
}

void Config::require_all_read() const {
  for (const char* table : kOwnedTables)
    if (has_table(table)) impl_->require_read(table);
  for (const char* owner : {"estimator", "controller"})
    if (const auto* table = impl_->root[owner].as_table())
      for (const auto& [sub, node] : *table)
        if (node.is_table()) impl_->require_read(join(owner, sub.str()));
}

std::string Config::resolved() const {
  return resolved_with(impl_->drive.effects);
}

std::string Config::resolved_with(std::vector<ConfiguredEffect> effects) const {
  DriveConfig drive = impl_->drive;
  drive.effects = std::move(effects);
  std::string text =
      write_drive(drive, [this](const char* path) { return impl_->owned_table_text(path); });
  for (const auto& [path, table_text] : impl_->owned_text)
    if (path.find('.') != std::string::npos) text += table_text;
  return text + write_effects(drive);
}

Config Config::with_effects(const std::string& effects_toml, const std::string& source) const {
  check_addition_to(&impl_->drive, effects_toml, source);
  return parse(resolved() + "\n" + effects_toml, source);
}

Config Config::known_at(std::int64_t k) const {
  const double t_s = (static_cast<double>(k) + 0.25) * drive().T_s();
  std::vector<ConfiguredEffect> effects;
  for (ConfiguredEffect e : drive().effects) {
    const bool known = e.is_known_at(t_s);
    if (!known && e.used_in == UsedIn::kModel) continue;
    if (!known) e.used_in = UsedIn::kPlant;
    e.known_from_s = 0;
    e.known_to_s = ConfiguredEffect{}.known_to_s;
    effects.push_back(e);
  }
  return parse(resolved_with(std::move(effects)), fmt::format("the drive file from tick {} on", k));
}

std::vector<ConfiguredEffect> Config::effects_in(const std::string& effects_toml,
                                                 const std::string& source) {
  return read_effects_in(effects_toml, source);
}

Config Config::without_effects(const std::string& effects_toml, const std::string& source,
                               std::size_t declared) const {
  const auto written = [](const ConfiguredEffect& effect) {
    DriveConfig only;
    only.effects = {effect};
    return write_effects(only);
  };
  std::vector<ConfiguredEffect> left = impl_->drive.effects;
  for (const ConfiguredEffect& effect : effects_in(effects_toml, source)) {
    const auto begin = left.begin() + static_cast<std::ptrdiff_t>(std::min(declared, left.size()));
    const auto found = std::find_if(begin, left.end(), [&](const ConfiguredEffect& added) {
      return written(added) == written(effect);
    });
    if (found == left.end())
      throw BadInput(
          fmt::format("{}: no {} with these values was added; only what a request added can be "
                      "removed",
                      source, effect.effect->kind()));
    left.erase(found);
  }
  return parse(resolved_with(std::move(left)), source);
}

void Config::check_addition(const std::string& effects_toml, const std::string& source) {
  check_addition_to(nullptr, effects_toml, source);
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

#include "loop/unused_keys.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>

#include "controller/controller.hpp"
#include "core/bridge_parameters.hpp"
#include "core/config_write.hpp"
#include "core/field_list.hpp"
#include "estimator/make_filter.hpp"
#include "plant_sim/plant_parameters.hpp"
#include "plant_sim/safety_parameters.hpp"

namespace twinrate {
namespace {

// The drive with the tables of its chosen parts, for the conditions of the rules.
class Settings {
 public:
  explicit Settings(Config& config) : drive(config.drive()) {
    take(config, "estimator." + drive.estimator.kind, filter_builder(drive.estimator.kind, drive));
    take(config, "controller." + drive.controller.kind,
         controller_builder(drive.controller.kind, drive));
    PlantParameters plant;
    take(config, "plant", &plant);
    SafetyParameters safety;
    take(config, "safety", &safety);
    BridgeParameters bridge;
    take(config, "bridge", &bridge);
  }
  // Of a key of the chosen parts, as text.
  std::string operator[](const std::string& key) const {
    const auto found = values_.find(key);
    return found == values_.end() ? "" : found->second;
  }
  bool uses(Compensation wanted) const {
    const auto& steps = drive.controller.compensation.steps();
    return std::any_of(steps.begin(), steps.end(), [&](const ProfileStep& step) {
      return step.value == static_cast<double>(wanted);
    });
  }

  const DriveConfig& drive;

 private:
  template <class Owner>
  void take(Config& config, const std::string& path, const Owner& owner) {
    const auto fields = [&](FieldVisitor& f) { owner->fields(f); };
    config.read_table(path, fields);
    for (const FieldRow& row : list_fields(fields)) values_[path + "." + row.key] = row.value_text;
  }
  std::map<std::string, std::string> values_;
};

// One key, or all keys of a table (it ends with a dot), and the settings with which they are read.
struct Rule {
  std::string key;
  std::function<bool(const Settings&)> is_read;
  std::string read_with;
};

Rule with(const std::string& key, const std::string& other, const std::string& value) {
  return {key, [=](const Settings& s) { return s[other] == value; }, other + " = " + value};
}

std::vector<Rule> rules_of_gains() {
  const auto background = [](const Settings& s) { return has_background(s.drive.gain.policy); };
  const std::string held = "a gain.policy other than scheduled";
  const auto makes_fault = [](const Settings& s) { return s["plant.fault.kind"] != "none"; };
  const std::string fault = "a plant.fault.kind other than none";
  const auto temperature = [](const Settings& s) {
    return s["safety.temperature_max_degC"] != "0.0" && s["safety.temperature_max_degC"] != "0";
  };
  const std::string watched = "safety.temperature_max_degC above 0";
  return {{"safety.temperature_derate_degC", temperature, watched},
          {"plant.winding.", temperature, watched},
          {"rates.n", background, held},
          {"rates.f_b_Hz", background, held},
          {"rates.n_from", background, held},
          {"rates.n_from_s",
           [](const Settings& s) {
             return has_background(s.drive.gain.policy) && s.drive.rates.n_from == NFrom::kStart;
           },
           "rates.n_from = start and " + held},
          {"gain.speed_span_rad_s",
           [](const Settings& s) { return s.drive.gain.policy == GainPolicy::kPropagated; },
           "gain.policy = propagated"},
          with("plant.erk_steps", "plant.engine", "erk"),
          {"plant.fault.at_s", makes_fault, fault},
          {"plant.fault.for_s", makes_fault, fault},
          {"plant.fault.value", makes_fault, fault},
          {"inverter.f_pwm_Hz",
           [](const Settings& s) {
             return s.drive.plant.inverter == InverterModel::kSwitched || !s.drive.effects.empty();
           },
           "plant.inverter = switched, or an [[effect]]"}};
}

std::vector<Rule> rules_of_filters() {
  std::vector<Rule> rules;
  for (const char* kind : {"backemf_printed", "active_flux"}) {
    const std::string table = std::string("estimator.") + kind + ".";
    rules.push_back(with(table + "limit_floor_rad", table + "limit", "true"));
    rules.push_back(with(table + "saliency_in_speed", table + "speed_from", "emf"));
  }
  for (const char* key : {"Q_order_Nm2", "P0_order_Nm2"})
    rules.push_back({std::string("estimator.ekf_joint.") + key,
                     [](const Settings& s) { return s["estimator.ekf_joint.order"] != "0"; },
                     "estimator.ekf_joint.order above 0"});
  rules.push_back(
      {"estimator.eemf.rotation",
       [](const Settings& s) { return s.drive.estimator.prediction == Prediction::kEuler; },
       "estimator.prediction = euler"});
  return rules;
}

bool estimates_the_angle(const Settings& s) {
  return s.drive.estimator.kind != "ekf_disturbance" && s.drive.estimator.kind != "ekf_harmonic";
}

// Start and watch, of either controller ("controller.foc.").
std::vector<Rule> rules_of_start_and_watch(const std::string& controller) {
  const auto aligns = [](const Settings& s) { return s.drive.start == Start::kAlignIf; };
  const auto fades = [=](const Settings& s) {
    return aligns(s) || (s.drive.start == Start::kFlying && s.drive.controller.kind == "lqr");
  };
  const auto watches = [=](const Settings& s) {
    return s.drive.controller.angle_source == AngleSource::kEstimate && estimates_the_angle(s);
  };
  const std::string startup = controller + "startup.", watch = controller + "synchronism.watch";
  const std::string estimated =
      "controller.angle_source = estimate and an estimator.kind that estimates the angle";
  return {{startup + "t_agree_s", aligns, "start = align_if"},
          {startup + "t_give_up_s", aligns, "start = align_if"},
          {startup + "t_fade_s", fades, "start = align_if, or flying with controller.kind = lqr"},
          {startup,
           [=](const Settings& s) {
             return aligns(s) || (watches(s) && s[watch] == "true" &&
                                  s[controller + "synchronism.reaction"] == "stop");
           },
           "start = align_if, or synchronism.reaction = stop"},
          {watch, watches, estimated},
          {controller + "synchronism.",
           [=](const Settings& s) { return watches(s) && s[watch] == "true"; },
           watch + " = true, " + estimated}};
}

std::vector<Rule> rules_of_foc() {
  const std::string foc = "controller.foc.";
  std::vector<Rule> rules = rules_of_start_and_watch(foc);
  rules.push_back(with(foc + "voltage_margin", foc + "field_weakening", "true"));
  rules.push_back(with(foc + "field_weakening_bandwidth_Hz", foc + "field_weakening", "true"));
  return rules;
}

std::vector<Rule> rules_of_lqr() {
  const std::string lqr = "controller.lqr.", gains = lqr + "gains";
  std::vector<Rule> rules;
  for (const char* key : {"K_d", "K_q"}) rules.push_back(with(lqr + key, gains, "given"));
  for (const char* key : {"Q_d", "R_d", "Q_q", "R_q"})
    rules.push_back(with(lqr + key, gains, "weights"));
  for (const char* key : {"deviation_d", "deviation_q"})
    rules.push_back(with(lqr + key, gains, "deviations"));
  for (const char* key : {"bandwidth_d_Hz", "bandwidth_q_Hz"})
    rules.push_back(with(lqr + key, gains, "bandwidths"));
  for (const Rule& rule : rules_of_start_and_watch(lqr)) rules.push_back(rule);
  rules.push_back(with(lqr + "voltage_margin", lqr + "field_weakening", "true"));
  rules.push_back(with(lqr + "field_weakening_bandwidth_Hz", lqr + "field_weakening", "true"));
  rules.push_back({lqr + "angle_domain.",
                   [](const Settings& s) { return s.uses(Compensation::kAngleDomain); },
                   "controller.compensation = angle_domain"});
  return rules;
}

bool is_real(const Settings& s) {
  return s.drive.plant.kind == PlantKind::kBridge;
}

// Keys that the protocol of the bridge reads. The mode is no condition: `bridge listen` and `bridge
// run` set it for the same file.
std::vector<Rule> rules_of_the_bridge() {
  const auto needs = [](const char* key, const std::map<std::string, std::string>& all) {
    std::string text;
    for (const auto& [other, value] : all)
      text += fmt::format("{}bridge.{} = {}", text.empty() ? "" : ", ", other, value);
    return Rule{std::string("bridge.") + key,
                [all](const Settings& s) {
                  return is_real(s) && std::all_of(all.begin(), all.end(), [&](const auto& one) {
                           return s["bridge." + one.first] == one.second;
                         });
                },
                "plant.kind = bridge, " + text};
  };
  return {needs("float64", {{"protocol", "twinrate"}}),
          needs("moteus_id", {{"protocol", "moteus"}, {"moteus_listen", "poll"}}),
          needs("moteus_control", {{"protocol", "moteus"}}),
          needs("moteus_listen", {{"protocol", "moteus"}}),
          needs("without_watchdog", {{"protocol", "moteus"}, {"moteus_control", "voltage"}}),
          {"bridge.theta_e_offset_rad",
           [](const Settings& s) { return is_real(s) && s["bridge.protocol"] != "twinrate"; },
           "plant.kind = bridge, bridge.protocol = moteus or vesc"},
          {"bridge.baud",
           [](const Settings& s) {
             return is_real(s) && !s["bridge.port"].starts_with("udp://") &&
                    s["bridge.emulate"] != "true";
           },
           "plant.kind = bridge and a serial bridge.port"},
          {"bridge.", is_real, "plant.kind = bridge"}};
}

// The first rule that fits a key decides; a table of another kind is never read.
std::vector<Rule> all_rules() {
  std::vector<Rule> rules;
  for (const auto& some : {rules_of_gains(), rules_of_filters(), rules_of_foc(), rules_of_lqr(),
                           rules_of_the_bridge()})
    rules.insert(rules.end(), some.begin(), some.end());
  return rules;
}

bool fits(const Rule& rule, const std::string& key) {
  return rule.key.ends_with('.') ? key.starts_with(rule.key) : key == rule.key;
}

// "" if a chosen part reads the key, else the settings with which one does.
std::string read_only_with(const std::string& key, const Settings& settings,
                           const std::vector<Rule>& rules) {
  for (const auto& [owner, kind] : {std::pair("estimator", settings.drive.estimator.kind),
                                    std::pair("controller", settings.drive.controller.kind)}) {
    const std::string table = std::string(owner) + ".";
    const auto dot = key.find('.', table.size());
    if (!key.starts_with(table) || dot == std::string::npos) continue;
    const std::string own = key.substr(table.size(), dot - table.size());
    if (own != kind) return fmt::format("{}.kind = {}", owner, own);
  }
  const auto rule =
      std::find_if(rules.begin(), rules.end(), [&](const Rule& r) { return fits(r, key); });
  return rule == rules.end() || rule->is_read(settings) ? "" : rule->read_with;
}

// Other headers may precede the mark (extended.toml).
bool is_resolved(const std::string& file) {
  constexpr int kHeaderLines = 30;
  std::ifstream in(file);
  std::string line;
  for (int i = 0; i < kHeaderLines && std::getline(in, line); ++i)
    if (line == kResolvedMark) return true;
  return false;
}

// Of --set, and of files that are neither a preset nor resolved by this program.
class Authors {
 public:
  bool is_user(const std::string& where) {
    if (where == "--set") return true;
    const std::string file = where.substr(0, where.rfind(':'));
    const auto known = is_user_.find(file);
    if (known != is_user_.end()) return known->second;
    std::error_code error;
    const bool preset = std::filesystem::equivalent(std::filesystem::path(file).parent_path(),
                                                    preset_directory(), error);
    return is_user_[file] = !preset && !is_resolved(file);
  }

 private:
  std::map<std::string, bool> is_user_;
};

void collect_keys(const toml::table& table, const std::string& prefix,
                  std::vector<std::string>& keys) {
  for (const auto& [key, node] : table) {
    const std::string path = prefix + std::string(key.str());
    if (const auto* sub = node.as_table())
      collect_keys(*sub, path + ".", keys);
    else if (path != "effect")
      keys.push_back(path);
  }
}

std::vector<std::string> keys_of_the_user(const Config& config) {
  std::vector<std::string> keys;
  collect_keys(toml::parse(config.merged()), "", keys);
  Authors authors;
  std::erase_if(keys, [&](const std::string& key) { return !authors.is_user(config.where(key)); });
  return keys;
}

std::string text_at(const toml::table& table, const std::string& key) {
  std::ostringstream text;
  text << table.at_path(key);
  return text.str();
}

// A preset holds keys of its alternatives; so does a file that began as a copy of it.
bool is_as_in_a_preset(const Config& config, const std::string& key) {
  if (config.where(key) == "--set") return false;
  const std::string mine = text_at(toml::parse(config.merged()), key);
  const std::vector<std::string> presets = preset_names();
  return std::any_of(presets.begin(), presets.end(), [&](const std::string& name) {
    return mine == text_at(toml::parse_file(preset_directory() + "/" + name + ".toml"), key);
  });
}

// covariance = "sequential" is a form of two filters; the others would silently take another.
void refuse_covariance(const Config& config) {
  const DriveConfig& drive = config.drive();
  const bool written_out =
      drive.estimator.kind == "ekf_sensorless" || drive.estimator.kind == "ekf_disturbance";
  if (drive.estimator.covariance != CovarianceForm::kSequential || written_out) return;
  throw BadInput(fmt::format(
      "{}: estimator.covariance: joseph, paper, auto allowed with estimator.kind = {}, found "
      "sequential",
      config.where("estimator.covariance"), drive.estimator.kind));
}

// "" if the parts of the drive support controller.compensation, else the missing condition.
std::string unmet_compensation(Config& config, const Settings& settings) {
  const auto filter = make_filter(config);
  for (const Compensation wanted :
       {Compensation::kLoad, Compensation::kPaper, Compensation::kAngleDomain})
    if (settings.uses(wanted))
      if (const std::string needs = compensation_needs(wanted, settings.drive, *filter);
          !needs.empty())
        return needs;
  return "";
}

// A preset's compensation has no effect if its alternatives do not support it, but no controller
// uses an angle that the drive does not provide.
void refuse_compensation(Config& config, const Settings& settings) {
  const std::string key = "controller.compensation", needs = unmet_compensation(config, settings);
  const std::vector<std::string> mine = keys_of_the_user(config);
  const bool of_the_user = std::find(mine.begin(), mine.end(), key) != mine.end();
  const bool must =
      settings.uses(Compensation::kAngleDomain) && settings.drive.controller.kind == "lqr";
  if (needs.empty() || !(of_the_user || must)) return;
  throw BadInput(
      fmt::format("{}: {}: has no effect here; it is read with {}", config.where(key), key, needs));
}

// Keys that only a simulated drive reads; in listen mode also those of the host's own control.
bool is_unread(const std::string& key, bool listens) {
  const auto in = [&](std::initializer_list<const char*> tables) {
    return std::any_of(tables.begin(), tables.end(),
                       [&](const char* t) { return key.starts_with(t); });
  };
  if (in({"plant.kind", "plant.delay_samples"})) return false;
  return in({"plant.", "load."}) ||
         (listens && in({"controller.", "safety.", "bridge.lease_ms", "bridge.moteus_control",
                         "bridge.without_watchdog"}));
}

}  // namespace

std::string keys_unread_by_a_real_drive(Config& config) {
  const BridgeParameters bridge = config.read<BridgeParameters>();
  if (config.drive().plant.kind != PlantKind::kBridge || bridge.emulate) return "";
  std::string unread;
  for (const std::string& key : keys_of_the_user(config))
    if (is_unread(key, bridge.mode == BridgeMode::kListen))
      unread += (unread.empty() ? "" : ", ") + key;
  return unread;
}

void refuse_unused_keys(Config& config) {
  refuse_covariance(config);
  const Settings settings(config);
  refuse_compensation(config, settings);
  const std::vector<Rule> rules = all_rules();
  for (const std::string& key : keys_of_the_user(config)) {
    const std::string with_what = read_only_with(key, settings, rules);
    if (!with_what.empty() && !is_as_in_a_preset(config, key))
      throw BadInput(fmt::format("{}: {}: has no effect here; it is read with {}",
                                 config.where(key), key, with_what));
  }
}

}  // namespace twinrate

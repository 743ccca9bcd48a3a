#include "datasheet/sheet.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <istream>
#include <ostream>

#include "core/config.hpp"

namespace twinrate {
namespace {

// True if a name is the beginning of a key, or the same quantity in another unit: "rated current"
// or "R", "kt_ozin_A" or "inertia_ozins2" in a sheet.
bool is_near(const std::string& name, const std::string& key) {
  const std::string quantity = name.substr(0, name.rfind('_'));
  if (key.rfind(name, 0) == 0 || key.rfind(quantity + "_", 0) == 0) return true;
  const auto word = name.find('_');
  if (word == std::string::npos || name.rfind("rated_", 0) == 0)
    return name.rfind("rated_", 0) == 0 && key.rfind(quantity.substr(0, name.find('_', 6)), 0) == 0;
  return key.rfind(name.substr(0, word + 1), 0) == 0 && key.find("convention") == std::string::npos;
}

// Other units of a sheet than the one in the key's name; `factor`: their size in that unit.
struct OtherUnit {
  const char* name;
  double factor;
};
constexpr double kOzIn_Nm = 7.0615518e-3,
                 kLbIn_Nm = 0.11298483;  // ounce, pound of force times inch
constexpr OtherUnit kTorques[] = {{"nm", 1},
                                  {"mnm", 1e-3},
                                  {"ncm", 1e-2},
                                  {"kgcm", 0.0980665},
                                  {"kgfcm", 0.0980665},
                                  {"ozin", kOzIn_Nm},
                                  {"lbin", kLbIn_Nm},
                                  {"inlb", kLbIn_Nm},
                                  {"lbft", 12 * kLbIn_Nm},
                                  {"ftlb", 12 * kLbIn_Nm},
                                  {"inoz", kOzIn_Nm}};
constexpr OtherUnit kInertias_kgm2[] = {{"kgm2", 1},
                                        {"kgcm2", 1e-4},
                                        {"gcm2", 1e-7},
                                        {"kgmm2", 1e-6},
                                        {"gm2", 1e-3},
                                        {"ozins2", kOzIn_Nm},
                                        {"inozs2", kOzIn_Nm},
                                        {"lbins2", kLbIn_Nm},
                                        {"inlbs2", kLbIn_Nm},
                                        {"ozin2", 1.8289979e-5},
                                        {"lbin2", 2.9263965e-4},
                                        {"lbfts2", 12 * kLbIn_Nm}};
constexpr OtherUnit kEmfs[] = {
    {"v/krpm", 1},     {"mv/rpm", 1},          {"v/rpm", 1e3},          {"mv/krpm", 1e-3},
    {"v/1000rpm", 1},  {"vs/rad", 104.719755}, {"v/rad/s", 104.719755}, {"v/(rad/s)", 104.719755},
    {"v/1000min1", 1}, {"v/kmin1", 1}};
constexpr OtherUnit kSpeedConstants[] = {
    {"rpm/v", 1}, {"min1/v", 1}, {"1/min/v", 1}, {"rad/s/v", 9.5492966}, {"rad/(vs)", 9.5492966}};
constexpr OtherUnit kResistances[] = {
    {"ohm", 1}, {"ohms", 1}, {"\xce\xa9", 1}, {"mohm", 1e-3}, {"m\xce\xa9", 1e-3}};
constexpr OtherUnit kInductances[] = {
    {"h", 1}, {"mh", 1e-3}, {"uh", 1e-6}, {"\xc2\xb5h", 1e-6}, {"\xce\xbch", 1e-6}};
constexpr OtherUnit kCurrents[] = {{"a", 1}, {"ma", 1e-3}};
constexpr OtherUnit kSpeeds[] = {{"rpm", 1}, {"min1", 1}, {"1/min", 1}, {"rad/s", 9.5492966}};
constexpr OtherUnit kVoltages[] = {{"v", 1}, {"kv", 1e3}};
constexpr OtherUnit kTimes[] = {{"ms", 1}, {"s", 1e3}};

std::span<const OtherUnit> units_of(const std::string& key) {
  const auto ends = [&](const char* text) { return key.ends_with(text); };
  if (key == "kt_Nm_A" || key == "rated_torque_Nm") return kTorques;
  if (key.starts_with("inertia_")) return kInertias_kgm2;
  if (ends("_V_krpm")) return kEmfs;
  if (ends("_rpm_V")) return kSpeedConstants;
  if (ends("_Ohm")) return kResistances;
  if (ends("_H")) return kInductances;
  if (key.starts_with("rated_current_")) return kCurrents;
  if (ends("_rpm")) return kSpeeds;
  if (ends("_V")) return kVoltages;
  if (ends("_ms")) return kTimes;
  return {};
}

// "oz-in-s^2" and "oz.in.s\xc2\xb2" are "ozins2".
std::string plain_unit(std::string text) {
  for (const auto& [from, to] :
       {std::pair{"\xc2\xb2", "2"}, {"\xc2\xb7", ""}, {"\xe2\x81\xbb\xc2\xb9", "1"}})
    for (std::size_t at; (at = text.find(from)) != std::string::npos;)
      text.replace(at, std::string_view(from).size(), to);
  std::string unit;
  for (const char c : text)
    if (std::string_view(" -*.^_").find(c) == std::string_view::npos)
      unit += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return unit;
}

// Size of the unit `text` in the unit of the key; empty if it is no unit of the key.
std::optional<double> factor_of(const std::string& key, const std::string& text) {
  std::string unit = plain_unit(text);
  if (key == "kt_Nm_A") {
    if (!unit.ends_with("/a")) return {};
    unit.resize(unit.size() - 2);
  }
  const auto units = units_of(key);
  const auto named = [&](const std::string& name) {
    return std::find_if(units.begin(), units.end(),
                        [&](const OtherUnit& u) { return u.name == name; });
  };
  const auto found = named(unit);
  if (found == units.end()) return {};
  if (!key.starts_with("inertia_")) return found->factor;
  return found->factor / named(key.substr(std::string_view("inertia_").size()))->factor;
}

const SheetKey& key_named(const std::string& name) {
  std::string known, near;
  for (const SheetKey& key : Sheet::keys()) {
    if (name == key.key) return key;
    known += (known.empty() ? "" : ", ") + std::string(key.key);
    if (is_near(name, key.key)) near += (near.empty() ? "" : " or ") + std::string(key.key);
  }
  if (!near.empty())
    throw BadInput(fmt::format(
        "data sheet: {}: unknown key; {} allowed, and behind the number a unit (5.35oz-in/A)", name,
        near));
  throw BadInput(fmt::format("data sheet: {}: unknown key; known: {}", name, known));
}

struct Number {
  double value = 0;
  std::string said;  // the conversion; empty without a unit
};

// A number, optionally followed by a unit.
Number number_of(const SheetKey& key, const std::string& text) {
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  bool is_number = error == std::errc() && stop == end && !text.empty();
  std::string said;
  if (error == std::errc() && stop != end) {
    const std::string unit(stop + (*stop == ' ' ? 1 : 0), end);
    const auto factor = factor_of(key.key, unit);
    if (!factor) {
      std::string known;
      for (const OtherUnit& other : units_of(key.key))
        known += (known.empty() ? "" : ", ") + std::string(other.name) +
                 (std::string_view(key.key) == "kt_Nm_A" ? "/a" : "");
      throw BadInput(fmt::format("data sheet: {}: \"{}\" is no unit of it{}", key.key, unit,
                                 known.empty() ? "" : "; known: " + known));
    }
    value *= *factor;
    is_number = true;
    if (*factor != 1)
      said = fmt::format("{} = {:.5g}: {}, {:.7g} of the key's unit a {}", key.key, value, text,
                         *factor, unit);
  }
  const bool is_whole = !key.whole || value == static_cast<int>(value);
  if (!is_number || !(value >= key.lo && value <= key.hi) || !is_whole)
    throw BadInput(fmt::format("data sheet: {}: a {}number from {:g} to {:g} allowed, found {}",
                               key.key, key.whole ? "whole " : "", key.lo, key.hi,
                               text.empty() ? "nothing" : text));
  return {value, said};
}

double choice_of(const SheetKey& key, const std::string& text) {
  for (std::size_t i = 0; i < key.choices.size(); ++i)
    if (text == key.choices[i]) return static_cast<double>(i);
  throw BadInput(fmt::format("data sheet: {}: one of {} allowed, found {}", key.key,
                             fmt::join(key.choices, ", "), text.empty() ? "nothing" : text));
}

std::string question(const SheetKey& key) {
  if (key.choices.empty()) return fmt::format("{} ({}): ", key.key, key.meaning);
  return fmt::format("{} ({}; {}): ", key.key, key.meaning, fmt::join(key.choices, ", "));
}

// Two units or two conventions of one value: if the first is given, ask() leaves the second out.
constexpr const char* kInstead[][2] = {{"poles", "n_p"},
                                       {"r_ll_Ohm", "r_phase_Ohm"},
                                       {"l_ll_H", "l_phase_H"},
                                       {"l_ll_H", "l_d_H"},
                                       {"l_phase_H", "l_d_H"},
                                       {"l_ll_H", "l_q_H"},
                                       {"l_phase_H", "l_q_H"},
                                       {"inertia_gcm2", "inertia_kgcm2"},
                                       {"inertia_gcm2", "inertia_kgm2"},
                                       {"inertia_kgcm2", "inertia_kgm2"},
                                       {"rated_current_A_rms", "rated_current_A_peak"},
                                       {"rated_current_A_rms", "rated_current_A_block"},
                                       {"rated_current_A_peak", "rated_current_A_block"}};

// "kv_convention" belongs to "kv_rpm_V".
bool is_asked(const SheetKey& key, const Sheet& sheet) {
  for (const auto& [given, other] : kInstead)
    if (std::string_view(key.key) == other && sheet.has(given)) return false;
  if (key.choices.empty()) return true;
  const std::string constant = std::string(key.key).substr(0, 3);
  for (const SheetKey& other : Sheet::keys())
    if (other.choices.empty() && std::string(other.key).starts_with(constant))
      return sheet.has(other.key);
  return true;
}

}  // namespace

const std::vector<SheetKey>& Sheet::keys() {
  static const std::vector<SheetKey> list = {
      {"poles", "poles, twice the pole pairs", 2, 400, true},
      {"n_p", "pole pairs, where the poles are not given", 1, 200, true},
      {"kv_rpm_V", "speed constant, rpm per volt", 1e-3, 1e6},
      {.key = "kv_convention", .meaning = "voltage of kv", .choices = kEmfConventionNames},
      {"ke_V_krpm", "EMF constant, volt at 1000 rpm", 1e-4, 1e5},
      {.key = "ke_convention", .meaning = "voltage of ke", .choices = kEmfConventionNames},
      {"kt_Nm_A", "torque constant, Nm per ampere", 1e-6, 1e4},
      {.key = "kt_convention", .meaning = "current of kt", .choices = kCurrentConventionNames},
      {"r_ll_Ohm", "resistance between two lines", 2e-4, 2e3},
      {"r_phase_Ohm", "resistance of one phase", 1e-4, 1e3},
      {"l_ll_H", "inductance between two lines", 2e-7, 20},
      {"l_phase_H", "inductance of one phase", 1e-7, 10},
      {"l_d_H", "d-axis inductance of a salient machine", 1e-7, 10},
      {"l_q_H", "q-axis inductance of a salient machine", 1e-7, 10},
      {"inertia_gcm2", "inertia of rotor and load, g cm2", 1e-2, 1e11},
      {"inertia_kgcm2", "inertia of rotor and load, kg cm2", 1e-5, 1e8},
      {"inertia_kgm2", "inertia of rotor and load, kg m2", 1e-9, 1e4},
      {"rated_current_A_rms", "rated phase current, rms", 1e-4, 1e4},
      {"rated_current_A_peak", "rated phase current, peak", 1e-4, 1e4},
      {"rated_current_A_block", "rated direct current in block commutation", 1e-4, 1e4},
      {"rated_torque_Nm", "rated torque", 1e-6, 1e6},
      {"rated_speed_rpm", "rated speed", 1e-1, 1e6},
      {"v_dc_V", "voltage of the DC bus", 1, 1e4},
      {"mechanical_time_constant_ms", "mechanical time constant, checks the other values", 1e-3,
       1e5},
      {"encoder_counts", "counts a turn, four times the lines; 0: no encoder", 0, 1 << 26, true},
      {"n_slots", "stator slots", 3, 2000, true}};
  return list;
}

void Sheet::set(const std::string& key, const std::string& value) {
  const SheetKey& known = key_named(key);
  if (has(key)) throw BadInput(fmt::format("data sheet: {}: given twice", key));
  if (!known.choices.empty()) {
    values_[key] = choice_of(known, value);
    return;
  }
  const Number number = number_of(known, value);
  values_[key] = number.value;
  if (!number.said.empty()) conversions_.push_back(number.said);
}

std::optional<double> Sheet::operator[](const std::string& key) const {
  const auto found = values_.find(key);
  return found == values_.end() ? std::nullopt : std::optional(found->second);
}

Sheet read_sheet(const std::vector<std::string>& pairs) {
  Sheet sheet;
  for (const std::string& pair : pairs) {
    const auto equals = pair.find('=');
    if (equals == std::string::npos)
      throw BadInput(fmt::format("data sheet: key=value allowed, found {}", pair));
    sheet.set(pair.substr(0, equals), pair.substr(equals + 1));
  }
  return sheet;
}

Sheet ask_for_sheet(std::istream& in, std::ostream& out) {
  Sheet sheet;
  out << "Values of the data sheet. Press Enter where it gives none. A value may have a unit: 5.35 "
         "oz-in/A.\n";
  for (const SheetKey& key : Sheet::keys()) {
    while (is_asked(key, sheet) && !sheet.has(key.key)) {
      out << question(key) << std::flush;
      std::string answer;
      if (!std::getline(in, answer))
        throw BadInput("data sheet: the input ended before the last question");
      if (answer.empty()) break;
      try {
        sheet.set(key.key, answer);
      } catch (const BadInput& error) {
        out << error.what() << "\n";
      }
    }
  }
  return sheet;
}

}  // namespace twinrate

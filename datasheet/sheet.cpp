#include "datasheet/sheet.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <istream>
#include <ostream>

#include "core/config.hpp"

namespace twinrate {
namespace {

// The beginning of one key or the same quantity: a sheet says "rated current" or "R".
bool is_near(const std::string& name, const std::string& key) {
  const std::string quantity = name.substr(0, name.rfind('_'));
  return key.rfind(name, 0) == 0 || key.rfind(quantity + "_", 0) == 0;
}

const SheetKey& key_named(const std::string& name) {
  std::string known, near;
  for (const SheetKey& key : Sheet::keys()) {
    if (name == key.key) return key;
    known += (known.empty() ? "" : ", ") + std::string(key.key);
    if (is_near(name, key.key)) near += (near.empty() ? "" : " or ") + std::string(key.key);
  }
  if (!near.empty())
    throw BadInput(fmt::format("data sheet: {}: unknown key; {} allowed", name, near));
  throw BadInput(fmt::format("data sheet: {}: unknown key; known: {}", name, known));
}

double number_of(const SheetKey& key, const std::string& text) {
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  const bool is_number = error == std::errc() && stop == end && !text.empty();
  const bool is_whole = !key.whole || value == static_cast<int>(value);
  if (!is_number || !(value >= key.lo && value <= key.hi) || !is_whole)
    throw BadInput(fmt::format("data sheet: {}: a {}number from {:g} to {:g} allowed, found {}",
                               key.key, key.whole ? "whole " : "", key.lo, key.hi,
                               text.empty() ? "nothing" : text));
  return value;
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

// One value in two units, or of two conventions: whoever gave one is not asked for the other.
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
      {"mechanical_time_constant_ms", "mechanical time constant, to check the others with", 1e-3,
       1e5},
      {"encoder_counts", "counts a turn, four times the lines; 0: no encoder", 0, 1 << 26, true},
      {"n_slots", "stator slots", 3, 2000, true}};
  return list;
}

void Sheet::set(const std::string& key, const std::string& value) {
  const SheetKey& known = key_named(key);
  if (has(key)) throw BadInput(fmt::format("data sheet: {}: given twice", key));
  values_[key] = known.choices.empty() ? number_of(known, value) : choice_of(known, value);
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
  out << "Values of the data sheet. Press Enter where it gives none.\n";
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

#include "import/guess_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <set>

#include "import/map.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kRpm = kTwoPi / 60;

std::string stripped(const std::string& text) {
  const auto begin = text.find_first_not_of(" _\t"), end = text.find_last_not_of(" _\t");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

// Endings that are units as written: "iq_A", "speed_rpm". Case distinguishes "_A" from phase "_a".
const std::vector<std::string>& unit_endings() {
  static const std::vector<std::string> endings{
      "_rad_per_s", "_rad_s", "_rads", "_rev_s", "_turns_s", "_deg_s", "_counts", "_turns",
      "_degC",      "_volts", "_amps", "_erpm",  "_mNm",     "_rpm",   "_RPM",    "_rad",
      "_deg",       "_sec",   "_Nm",   "_Vs",    "_Wb",      "_mA",    "_mV",     "_ms",
      "_us",        "_ns",    "_pct",  "_Hz",    "_A",       "_V",     "_s"};
  return endings;
}

bool any_of(const std::string& text, std::initializer_list<const char*> parts) {
  return std::any_of(parts.begin(), parts.end(),
                     [&](const char* part) { return text.find(part) != std::string::npos; });
}

std::string without(std::string text, std::initializer_list<const char*> parts) {
  for (const std::string part : parts)
    if (const auto at = text.find(part); at != std::string::npos) text.erase(at, part.size());
  return text;
}

using Names = std::map<std::string, const char*>;

// Plain names of one meaning. References have lost "ref", "setpoint" .. before.
const Names& currents() {
  static const Names names{
      {"ia", "i_a"},         {"ib", "i_b"},       {"ic", "i_c"},        {"iu", "i_a"},
      {"iv", "i_b"},         {"iw", "i_c"},       {"iphasea", "i_a"},   {"iphaseb", "i_b"},
      {"iphasec", "i_c"},    {"iphaseu", "i_a"},  {"iphasev", "i_b"},   {"iphasew", "i_c"},
      {"ialpha", "i_alpha"}, {"ibeta", "i_beta"}, {"ialfa", "i_alpha"}, {"id", "i_d"},
      {"iq", "i_q"},
  };
  return names;
}

// "Strom Phase U", "Courant phase a", "Motor Current Q": a word for a current and an axis. A word
// with an A or V alone ("Current A") may be a unit: there must be another phase beside it.
std::string spelled_current(const std::string& text, const std::vector<std::string>& columns) {
  if (!any_of(text, {"strom", "courant", "current"})) return "";
  static const std::map<std::string, const char*> axes{
      {"a", "i_a"}, {"b", "i_b"}, {"c", "i_c"},         {"u", "i_a"},
      {"v", "i_b"}, {"w", "i_c"}, {"alpha", "i_alpha"}, {"beta", "i_beta"},
      {"d", "i_d"}, {"q", "i_q"}, {"daxis", "i_d"},     {"qaxis", "i_q"}};
  const auto found = axes.find(without(
      text, {"strom", "courant", "current", "phasen", "phase", "motor", "moteur", "stator"}));
  if (found == axes.end()) return "";
  if (!text.ends_with("a") || found->first != "a")
    if (!text.ends_with("v") || found->first != "v") return found->second;
  const std::string stem = text.substr(0, text.size() - 1);
  for (const std::string& other : columns)
    for (const char phase : {'b', 'c', 'u', 'w'})
      if (plain(other) == stem + phase) return found->second;
  return "unit";
}
const Names& voltages() {
  static const Names names{{"ud", "u_d"},
                           {"uq", "u_q"},
                           {"vd", "u_d"},
                           {"vq", "u_q"},
                           {"voltaged", "u_d"},
                           {"voltageq", "u_q"},
                           {"ualpha", "u_alpha"},
                           {"ubeta", "u_beta"},
                           {"valpha", "u_alpha"},
                           {"vbeta", "u_beta"},
                           {"vdc", "v_dc"},
                           {"udc", "v_dc"},
                           {"vbus", "v_dc"},
                           {"ubus", "v_dc"},
                           {"busvoltage", "v_dc"},
                           {"vdcbus", "v_dc"},
                           {"dcbusvoltage", "v_dc"},
                           {"vbusvoltage", "v_dc"},
                           {"dclinkvoltage", "v_dc"},
                           {"dcvoltage", "v_dc"},
                           {"udclink", "v_dc"},
                           {"vdclink", "v_dc"},
                           {"uzk", "v_dc"},
                           {"zwischenkreisspannung", "v_dc"},
                           {"spannungzwischenkreis", "v_dc"},
                           {"tensionbus", "v_dc"},
                           {"busdcvoltage", "v_dc"}};
  return names;
}

Meaning of_angle_or_speed(const std::string& text, bool reference) {
  const bool mechanical = any_of(text, {"mech", "shaft"}) ||
                          std::set<std::string>{"thetam", "omegam", "wm"}.count(text);
  const bool electrical =
      any_of(text, {"elec", "erpm"}) ||
      std::set<std::string>{"thetae", "omegae", "we", "thetael", "omegael", "wel"}.count(text);
  const std::string core =
      without(text, {"mechanical", "electrical", "mech", "elec", "shaft", "rotor", "motor",
                     "moteur", "actual", "measured", "meas"});
  const bool angle = std::set<std::string>{"theta", "thetam",   "thetae", "thetael", "angle",
                                           "pos",   "position", "winkel", "encoder", "encodercount"}
                         .count(core);
  const bool speed = std::set<std::string>{"omega", "omegam",   "omegae", "omegael",  "wm",  "we",
                                           "wel",   "w",        "speed",  "velocity", "vel", "rpm",
                                           "n",     "drehzahl", "erpm",   "vitesse"}
                         .count(core);
  Meaning m;
  if (!angle && !speed) return m;
  m.quantity = angle ? Quantity::kAngle : Quantity::kSpeed;
  m.said_mechanical = mechanical;
  if (electrical)
    m.reason = fmt::format("an electrical {}; a drive log has the mechanical one",
                           angle ? "angle" : "speed");
  else if (angle && reference)
    m.reason = "a drive log has no angle reference";
  else
    m.canonical = angle ? "theta_m" : reference ? "omega_m_ref" : "omega_m";
  return m;
}

}  // namespace

std::string plain(const std::string& name) {
  std::string text;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)))
      text += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

NamedUnit named_unit(const std::string& column) {
  for (const auto& [open, close] : {std::pair{'[', ']'}, {'(', ')'}}) {
    const auto from = column.rfind(open), to = column.rfind(close);
    if (from != std::string::npos && to != std::string::npos && to > from && from > 0)
      return {stripped(column.substr(0, from) + column.substr(to + 1)),
              stripped(column.substr(from + 1, to - from - 1))};
  }
  // "U_DC/V", "n/min^-1", "Strom U in A".
  for (const std::string between : {"/", " in "})
    if (const auto at = column.find(between); at != std::string::npos && at > 0)
      if (const std::string unit = stripped(column.substr(at + between.size())); unit_of(unit))
        return {stripped(column.substr(0, at)), unit};
  // "I_V" is the current of phase V.
  for (const std::string& ending : unit_endings())
    if (column.size() > ending.size() && column.ends_with(ending) && column != "I_V")
      return {column.substr(0, column.size() - ending.size()), ending.substr(1)};
  return {stripped(column), ""};
}

std::optional<Unit> unit_of(const std::string& text) {
  std::string unit;
  for (const char c : text)
    if (c != ' ') unit += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (text == "MA" || text == "MV" || text == "MS" || text == "S") return {};  // mega, siemens?
  using Q = Quantity;
  static const std::map<std::string, Unit> units = [] {
    std::map<std::string, Unit> map;
    const auto add = [&](std::initializer_list<const char*> names, const Unit& u) {
      for (const char* name : names) map[name] = u;
    };
    add({"s", "sec", "second", "seconds"}, {.quantity = Q::kTime});
    add({"ms", "msec"}, {.quantity = Q::kTime, .scale = 1e-3});
    add({"min"}, {.quantity = Q::kTime, .scale = 60});
    add({"us", "\xc2\xb5s", "\xce\xbcs", "usec"}, {.quantity = Q::kTime, .scale = 1e-6});
    add({"ns", "nsec"}, {.quantity = Q::kTime, .scale = 1e-9});
    add({"a", "amp", "amps", "ampere", "amperes"}, {.quantity = Q::kCurrent});
    add({"ma", "milliamps"}, {.quantity = Q::kCurrent, .scale = 1e-3});
    add({"arms", "a_rms", "ar.m.s."},
        {.quantity = Q::kCurrent, .problem = "an rms value is no sample of a current"});
    add({"v", "volt", "volts"}, {.quantity = Q::kVoltage});
    add({"mv"}, {.quantity = Q::kVoltage, .scale = 1e-3});
    add({"kv"}, {.quantity = Q::kVoltage, .scale = 1e3});
    add({"rad"}, {.quantity = Q::kAngle});
    add({"deg", "degree", "degrees", "grad", "\xc2\xb0"},
        {.quantity = Q::kAngle, .scale = kTwoPi / 360});
    add({"turn", "turns", "rev", "revs", "revolutions"},
        {.quantity = Q::kAngle, .scale = kTwoPi, .mechanical = true});
    add({"count", "counts", "cnt", "ticks", "inc", "lsb"},
        {.quantity = Q::kAngle, .problem = "counts: how many make a turn is not in the file"});
    add({"rad/s", "rad_s", "rads", "rad_per_s", "rad/sec", "rads/s", "rads-1"},
        {.quantity = Q::kSpeed});
    add({"rpm", "r/min", "1/min", "min-1", "min^-1", "u/min", "tr/min", "rev/min"},
        {.quantity = Q::kSpeed, .scale = kRpm, .mechanical = true});
    add({"krpm"}, {.quantity = Q::kSpeed, .scale = 1000 * kRpm, .mechanical = true});
    add({"rev/s", "rev_s", "rps", "turns/s", "turn/s", "turns_s", "r/s"},
        {.quantity = Q::kSpeed, .scale = kTwoPi, .mechanical = true});
    add({"deg/s", "deg_s", "\xc2\xb0/s"}, {.quantity = Q::kSpeed, .scale = kTwoPi / 360});
    add({"erpm"}, {.quantity = Q::kSpeed, .problem = "electrical revolutions per minute"});
    add({"hz"}, {.quantity = Q::kSpeed,
                 .problem = "Hz is written for electrical and for mechanical frequencies"});
    add({"nm", "n.m", "n*m", "n\xc2\xb7m", "n-m"}, {.quantity = Q::kTorque});
    add({"mnm"}, {.quantity = Q::kTorque, .scale = 1e-3});
    add({"c", "degc",
         "\xc2\xb0"
         "c"},
        {.quantity = Q::kTemperature});
    add({"k"}, {.quantity = Q::kTemperature, .offset = -273.15});
    add({"wb", "vs", "v.s", "v*s"}, {.quantity = Q::kFlux});
    add({"mwb", "mvs"}, {.quantity = Q::kFlux, .scale = 1e-3});
    add({"%", "pct", "percent"}, {.quantity = Q::kDuty, .scale = 0.01});
    return map;
  }();
  const auto found = units.find(unit);
  if (found == units.end()) return {};
  return found->second;
}

// "-i_q", "|i_q|", "i_q + 1": another quantity, or a sign that is not read here (a delta).
static bool is_formula(const std::string& name) {
  return name.starts_with('-') || name.find_first_of("|+^~=<>") != std::string::npos ||
         (name.find('*') != std::string::npos && !name.ends_with('*')) ||
         std::any_of(name.begin(), name.end(),
                     [](char c) { return static_cast<unsigned char>(c) >= 0x80; });
}

static Meaning of_current(const std::string& bare, const std::string& canonical, bool reference,
                          const std::vector<std::string>& columns) {
  const bool dq = canonical == "i_d" || canonical == "i_q";
  const bool has_q = std::any_of(columns.begin(), columns.end(), [](const std::string& other) {
    return plain(other).starts_with("iq") || plain(other).starts_with("currentq");
  });
  if (bare == "id" && !has_q)
    return {.reason = "id: a d-axis current or an identifier? no q-axis current stands beside it"};
  if (reference && !dq) return {.reason = "a drive log has references of i_d and i_q only"};
  return {.canonical = canonical + (reference ? "_ref" : ""), .quantity = Quantity::kCurrent};
}

static std::optional<Meaning> of_phase_or_axis(const std::string& text) {
  for (const char phase : {'a', 'b', 'c'})
    if (text == std::string("duty") + phase || text == std::string("dutycycle") + phase)
      return Meaning{.canonical = std::string("duty_") + phase, .quantity = Quantity::kDuty};
  for (const char phase : {'a', 'b', 'c'})
    if (text == std::string("u") + phase || text == std::string("v") + phase)
      return Meaning{.canonical = std::string("u_") + phase, .quantity = Quantity::kVoltage};
  for (const char axis : {'d', 'q'})
    if (text == std::string("psi") + axis || text == std::string("lambda") + axis)
      return Meaning{.canonical = std::string("psi_") + axis, .quantity = Quantity::kFlux};
  return {};
}

static Meaning of_torque(const std::string& text, bool reference) {
  if (reference && std::set<std::string>{"torque", "motortorque", "drehmoment"}.count(text))
    return {.canonical = "torque_ref", .quantity = Quantity::kTorque};
  if (text == "loadtorque" || text == "torqueload" || text == "tload")
    return {.canonical = "T_load", .quantity = Quantity::kTorque};
  if (any_of(text, {"shaft", "meas", "sensor", "cell", "transducer"}))
    return {.canonical = "torque", .quantity = Quantity::kTorque};
  return {.quantity = Quantity::kTorque,
          .reason = "a torque: measured at the shaft, or computed from currents?"};
}

static Meaning meaning_of_plain(const std::string& name, const std::vector<std::string>& columns) {
  std::string text = plain(name);
  const bool reference =
      name.ends_with('*') ||
      any_of(text, {"ref", "setpoint", "soll", "cmd", "command", "target", "demand", "desired"}) ||
      text.ends_with("set") || text.ends_with("sp");
  if (any_of(text, {"err", "filt", "limit", "max", "min", "rms", "offset", "pred", "hat"}) ||
      (text.ends_with("est") && !reference))
    return {.reason = "no signal of a drive log by its name"};
  if (reference)
    text = without(text, {"reference", "ref", "setpoint", "soll", "command", "cmd", "target",
                          "demand", "desired"});
  if (reference && (text.ends_with("set") || text.ends_with("sp")))
    text.resize(text.size() - (text.ends_with("set") ? 3 : 2));
  std::string bare = without(text, {"measured", "meas", "actual", "ist", "fbk"});
  if (bare.ends_with("act")) bare.resize(bare.size() - 3);

  if (std::set<std::string>{"t", "ts", "time", "timestamp", "zeit", "tout", "xaxis", "elapsedtime",
                            "elapsed", "xvalue", "temps"}
          .count(text))
    return {.canonical = reference ? "" : "t", .quantity = Quantity::kTime};
  const std::string spelled = spelled_current(bare, columns);
  if (spelled == "unit")
    return {.reason = "the phase, or the unit? no other phase stands beside it"};
  if (const auto found = currents().find(bare); found != currents().end() || !spelled.empty()) {
    return of_current(bare, spelled.empty() ? found->second : spelled, reference, columns);
  }
  if (const auto found = voltages().find(bare); found != voltages().end()) {
    const std::string canonical = found->second;
    if (reference && canonical == "v_dc") return {.reason = "a reference of the bus voltage"};
    return {.canonical = canonical, .quantity = Quantity::kVoltage};
  }
  if (const auto found = of_phase_or_axis(text)) return *found;
  if (std::set<std::string>{"tempmotor", "motortemp", "motortemperature", "windingtemperature",
                            "temperaturewinding", "windingtemp"}
          .count(text))
    return {.canonical = "temperature", .quantity = Quantity::kTemperature};
  if (any_of(text, {"torque", "drehmoment"}) || text == "tload") return of_torque(text, reference);
  Meaning m = of_angle_or_speed(bare, reference);
  if (m.canonical.empty() && m.reason.empty()) m.reason = "no signal of a drive log by its name";
  return m;
}

Meaning meaning_of(const std::string& name, const std::vector<std::string>& columns) {
  const Meaning meaning = meaning_of_plain(name, columns);
  if (!meaning.canonical.empty() && is_formula(name))
    return {.reason = "the name contains more than a quantity"};
  return meaning;
}

// VESC: vesc_tool, "Log CSV" and bldc, terminal of COMM_GET_VALUES. ODrive: interface definition of
// firmware 0.5 and 0.6. moteus: docs/reference.md, servo_stats and the register table. SimpleFOC:
// FOCMotor::monitor(), which prints currents in milliamperes.
const std::vector<ToolColumn>& tool_columns() {
  static const char* const vesc_dq =
      "of the dq frame of the VESC's observer, mean between two polls: no phase quantity";
  static const char* const counts_or_turns =
      "counts before firmware 0.5.1, turns from then on: the file does not say which";
  static const std::vector<ToolColumn> columns{
      {"vesc", "ms_today", "t", 1e-3, false, "ms"},
      {"vesc", "input_voltage", "v_dc", 1, false, "V"},
      {"vesc", "temp_motor", "temperature", 1, false, "degC"},
      {"vesc", "erpm", "omega_m", kRpm, true, "electrical revolutions per minute"},
      {"vesc", "d_axis_current", "", 1, false, vesc_dq},
      {"vesc", "q_axis_current", "", 1, false, vesc_dq},
      {"vesc", "d_axis_voltage", "", 1, false, vesc_dq},
      {"vesc", "q_axis_voltage", "", 1, false, vesc_dq},
      {"vesc", "current_motor", "", 1, false, "length of the current vector, filtered: no phase"},
      {"vesc", "current_in", "", 1, false, "current of the battery"},
      {"vesc", "duty_cycle", "", 1, false, "length of the voltage vector over the bus voltage"},
      {"vesc", "encoder_position", "", 1, false,
       "of the position loop; its angle division is not in the file"},
      {"vesc", "tachometer", "", 1, false, "commutation steps"},
      {"odrive", "Iq_measured", "i_q", 1, false, "A"},
      {"odrive", "Id_measured", "i_d", 1, false, "A"},
      {"odrive", "Iq_setpoint", "i_q_ref", 1, false, "A"},
      {"odrive", "Id_setpoint", "i_d_ref", 1, false, "A"},
      {"odrive", "current_meas_phB", "i_b", 1, false, "A"},
      {"odrive", "current_meas_phC", "i_c", 1, false, "A"},
      {"odrive", "vbus_voltage", "v_dc", 1, false, "V"},
      {"odrive", "pos_vel_mapper.vel", "omega_m", kTwoPi, false, "turns/s"},
      {"odrive", "pos_vel_mapper.pos_rel", "theta_m", kTwoPi, false, "turns"},
      {"odrive", "pos_vel_mapper.pos_abs", "theta_m", kTwoPi, false, "turns"},
      {"odrive", "encoder.pos_estimate", "", 1, false, counts_or_turns},
      {"odrive", "encoder.vel_estimate", "", 1, false, counts_or_turns},
      {"odrive", "encoder.pos_cpr", "", 1, false, counts_or_turns},
      {"odrive", "ibus", "", 1, false, "current of the supply"},
      {"moteus", "servo_stats.q_A", "i_q", 1, false, "A"},
      {"moteus", "servo_stats.d_A", "i_d", 1, false, "A"},
      {"moteus", "servo_stats.velocity", "omega_m", kTwoPi, false,
       "rev/s of the output: right without a gear (rotor_to_output_ratio = 1)"},
      {"moteus", "servo_stats.position", "theta_m", kTwoPi, false,
       "rev of the output: right without a gear (rotor_to_output_ratio = 1)"},
      {"moteus", "servo_stats.bus_V", "v_dc", 1, false, "V"},
      {"moteus", "servo_stats.motor_temp_C", "temperature", 1, false, "degC"},
      {"moteus", "servo_stats.torque_Nm", "", 1, false, "computed from i_q, not measured"},
      {"moteus", "servo_stats.cur1_A", "", 1, false, "the order of the phases is a setting"},
      {"moteus", "servo_stats.cur2_A", "", 1, false, "the order of the phases is a setting"},
      {"moteus", "servo_stats.cur3_A", "", 1, false, "the order of the phases is a setting"},
      {"simplefoc", "current_q", "i_q", 1e-3, false, "mA: monitor() multiplies by 1000"},
      {"simplefoc", "current_d", "i_d", 1e-3, false, "mA: monitor() multiplies by 1000"},
      {"simplefoc", "voltage_q", "u_q", 1, false, "V"},
      {"simplefoc", "voltage_d", "u_d", 1, false, "V"},
      {"simplefoc", "velocity", "omega_m", 1, false, "rad/s of the shaft"},
      {"simplefoc", "angle", "theta_m", 1, false, "rad of the shaft"},
      {"simplefoc", "shaft_angle", "theta_m", 1, false, "rad of the shaft"},
      {"simplefoc", "target", "", 1, false, "its unit is that of the controller in use"}};
  return columns;
}

}  // namespace twinrate

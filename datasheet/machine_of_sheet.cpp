#include "datasheet/machine_of_sheet.hpp"

#include <fmt/format.h>

#include <cmath>
#include <initializer_list>

#include "core/config.hpp"
#include "loop/slips.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kSqrt2 = std::numbers::sqrt2, kSqrt3 = std::numbers::sqrt3;
constexpr double kEqual = 1e-6;  // relative: one value in two units
// Data sheets give the constants with two or three digits, and tolerances of 5 to 10 %.
constexpr double kTolerance = 0.1;
// If both constants come from one measurement, they differ only by rounding.
constexpr double kBlockTolerance = 0.03;
// A mechanical time constant depends on R_s and K_t^2, each with its tolerance; K_t is sometimes
// that of a warm motor.
constexpr double kTimeTolerance = 1.35;
// Sheets do not give the friction. Bearings and air cause about this share of the rated torque.
constexpr double kFrictionShare = 0.01;

constexpr const char* kNoInertia =
    "; where the sheet gives none: mass of the rotor times its radius squared (a bell), or half of "
    "that (a solid rotor)";

// Phase EMF, peak, of 1 V in this convention.
double phase_peak(EmfConvention convention) {
  switch (convention) {
    case EmfConvention::kLinePeak:
      return 1 / kSqrt3;
    case EmfConvention::kLineRms:
      return kSqrt2 / kSqrt3;
    case EmfConvention::kPhasePeak:
      return 1;
    case EmfConvention::kPhaseRms:
      return kSqrt2;
  }
  return 1;
}
const char* words(EmfConvention convention) {
  constexpr const char* kWords[] = {"line to line, peak", "line to line, rms", "phase, peak",
                                    "phase, rms"};
  return kWords[static_cast<int>(convention)];
}

// Two constants of one motor.
constexpr RatioBand kAgree{1 - kTolerance, 1 + kTolerance};

// A unit in which a sheet can give a value: `to_SI` times the number.
struct Unit {
  const char* key;
  double to_SI;
  const char* how;
};

class Conversion {
 public:
  explicit Conversion(const Sheet& sheet) : sheet_(sheet) {}

  MachineOfSheet run() {
    result_.conversions = sheet_.conversions();
    MachineParameters& m = result_.machine;
    m.n_p = pole_pairs();
    m.R_s =
        of_units("R_s_Ohm", {{"r_phase_Ohm", 1, ""}, {"r_ll_Ohm", 0.5, "half of line to line"}});
    inductances();
    m.J = of_units("J_kgm2", {{"inertia_kgm2", 1, ""},
                              {"inertia_gcm2", 1e-7, "1e-7 kg m2 a g cm2"},
                              {"inertia_kgcm2", 1e-4, "1e-4 kg m2 a kg cm2"}});
    m.i_rated = current();
    m.psi_f = flux();
    ratings();
    time_constant();
    result_.v_dc = need("v_dc_V");
    result_.encoder_counts = static_cast<int>(sheet_["encoder_counts"].value_or(0));
    m.n_slots = static_cast<int>(sheet_["n_slots"].value_or(0));
    return std::move(result_);
  }

 private:
  double need(const char* key) const {
    if (const auto value = sheet_[key]) return *value;
    throw BadInput(fmt::format("data sheet: {} is required", key));
  }
  void say(const char* key, double value, const std::string& from) {
    result_.conversions.push_back(fmt::format("{} = {:.5g}: {}", key, value, from));
  }

  // A value that a sheet gives in one of several units; values in two units must agree.
  double of_units(const char* key, std::initializer_list<Unit> units) {
    const Unit* given = nullptr;
    std::string keys;
    for (const Unit& unit : units) {
      keys += (keys.empty()               ? ""
               : &unit + 1 == units.end() ? " or "
                                          : ", ") +
              std::string(unit.key);
      const auto number = sheet_[unit.key];
      if (!number) continue;
      if (!given)
        given = &unit;
      else
        expect_same(*given, unit);
    }
    if (!given)
      throw BadInput(fmt::format("data sheet: {} is required{}", keys,
                                 std::string_view(key) == "J_kgm2" ? kNoInertia : ""));
    const double number = *sheet_[given->key], value = given->to_SI * number;
    if (given->to_SI != 1)
      say(key, value, fmt::format("{} = {:g}, {}", given->key, number, given->how));
    return value;
  }
  void expect_same(const Unit& one, const Unit& other) const {
    const double a = *sheet_[one.key], b = *sheet_[other.key];
    if (std::abs(a * one.to_SI - b * other.to_SI) > kEqual * a * one.to_SI)
      throw BadInput(
          fmt::format("data sheet: {} = {:g} and {} = {:g} contradict each other; one "
                      "of them allowed",
                      one.key, a, other.key, b));
  }

  int pole_pairs() {
    const auto poles = sheet_["poles"];
    if (poles && std::fmod(*poles, 2) != 0)
      throw BadInput(fmt::format("data sheet: poles: an even number allowed, found {:g}", *poles));
    return static_cast<int>(of_units("n_p", {{"n_p", 1, ""}, {"poles", 0.5, "half of the poles"}}));
  }

  void inductances() {
    MachineParameters& m = result_.machine;
    if (sheet_.has("l_d_H") || sheet_.has("l_q_H")) {
      m.L_d = need("l_d_H");
      m.L_q = need("l_q_H");
      if (!sheet_.has("l_ll_H") && !sheet_.has("l_phase_H")) return;
      throw BadInput("data sheet: l_d_H, l_q_H exclude l_ll_H and l_phase_H");
    }
    m.L_d = m.L_q =
        of_units("L_d_H, L_q_H", {{"l_phase_H", 1, ""}, {"l_ll_H", 0.5, "half of line to line"}});
    result_.assumed.push_back(
        "L_d_H = L_q_H: one inductance is given; a rotor with inner magnets "
        "has two (l_d_H, l_q_H)");
  }

  double current() {
    const bool sinusoidal = sheet_.has("rated_current_A_peak") || sheet_.has("rated_current_A_rms");
    if (sheet_.has("rated_current_A_block") && sinusoidal)
      throw BadInput("data sheet: rated_current_A_block excludes rated_current_A_rms and _A_peak");
    for (const char* key : {"rated_current_A_peak", "rated_current_A_rms", "rated_current_A_block"})
      if (sheet_.has(key))
        return of_units(
            "i_rated_A",
            {{"rated_current_A_peak", 1, ""},
             {"rated_current_A_rms", kSqrt2, "sqrt(2) times the rms value"},
             {"rated_current_A_block", 2 / kSqrt3, "2/sqrt(3) of it: the same copper loss"}});
    return 0;  // of the torque, in ratings()
  }

  EmfConvention emf_convention(const char* key, const char* constant, EmfConvention usual) {
    if (const auto given = sheet_[key]) return static_cast<EmfConvention>(static_cast<int>(*given));
    result_.assumed.push_back(
        fmt::format("{} is {} ({} = {}): the usual one; the sheet may mean another", constant,
                    words(usual), key, kEmfConventionNames[static_cast<int>(usual)]));
    return usual;
  }
  CurrentConvention current_convention() {
    if (const auto given = sheet_["kt_convention"])
      return static_cast<CurrentConvention>(static_cast<int>(*given));
    const auto as_rated = sheet_.has("rated_current_A_rms")     ? CurrentConvention::kRms
                          : sheet_.has("rated_current_A_block") ? CurrentConvention::kBlock
                                                                : CurrentConvention::kPeak;
    const char* name = kCurrentConventionNames[static_cast<int>(as_rated)];
    result_.assumed.push_back(fmt::format(
        "kt_Nm_A is Nm per ampere {} (kt_convention = {}), as the rated current", name, name));
    return as_rated;
  }

  struct Flux {
    double psi_f;
    std::string from;
  };
  // The flux linkage from every constant of the sheet, the EMF constants first: they are measured
  // without a load.
  std::vector<Flux> fluxes() {
    const double n_p = result_.machine.n_p;
    std::vector<Flux> list;
    if (const auto ke = sheet_["ke_V_krpm"]) {
      const auto c = emf_convention("ke_convention", "ke_V_krpm", EmfConvention::kLineRms);
      list.push_back({phase_peak(c) * *ke / (1000 * kRadPerRpm * n_p),
                      fmt::format("ke_V_krpm = {:g}, {}", *ke, words(c))});
    }
    if (const auto kv = sheet_["kv_rpm_V"]) {
      const auto c = emf_convention("kv_convention", "kv_rpm_V", EmfConvention::kLinePeak);
      list.push_back({phase_peak(c) / (*kv * kRadPerRpm * n_p),
                      fmt::format("kv_rpm_V = {:g}, {}", *kv, words(c))});
    }
    if (const auto kt = sheet_["kt_Nm_A"]) {
      const auto c = current_convention();
      const double peak = *kt * (c == CurrentConvention::kRms     ? 1 / kSqrt2
                                 : c == CurrentConvention::kBlock ? kSqrt3 / 2
                                                                  : 1);
      list.push_back(
          {peak / (1.5 * n_p),
           fmt::format("kt_Nm_A = {:g}, Nm per ampere {}, {} of it", *kt,
                       kCurrentConventionNames[static_cast<int>(c)],
                       c == CurrentConvention::kBlock ? "1/(sqrt(3) n_p)" : "2/(3 n_p)")});
    }
    return list;
  }
  // Sheets of brushless DC motors give K_t per ampere of direct current: K_t K_v = 30/pi.
  std::string block_hint(double psi_f) const {
    const auto kt = sheet_["kt_Nm_A"];
    if (!kt) return "";
    const double of_block = *kt / (kSqrt3 * result_.machine.n_p);
    if (std::abs(std::log(of_block / psi_f)) > kBlockTolerance) return "";
    return "; they agree if kt_Nm_A is of the direct current in block commutation: kt_convention = "
           "block, and the rated current then is rated_current_A_block";
  }

  double flux() {
    const std::vector<Flux> list = fluxes();
    if (list.empty()) throw BadInput("data sheet: kv_rpm_V, ke_V_krpm or kt_Nm_A is required");
    say("psi_f_Wb", list[0].psi_f, list[0].from);
    for (std::size_t i = 1; i < list.size(); ++i) {
      const double ratio = list[i].psi_f / list[0].psi_f;
      if (std::abs(std::log(ratio)) <= kTolerance) continue;
      result_.doubts.push_back(fmt::format("psi_f_Wb is {:.4g} by {} and {:.4g} by {}: {}{}",
                                           list[0].psi_f, list[0].from, list[i].psi_f, list[i].from,
                                           factor_text(ratio, kAgree), block_hint(list[0].psi_f)));
    }
    return list[0].psi_f;
  }

  void ratings() {
    MachineParameters& m = result_.machine;
    m.T_rated = sheet_["rated_torque_Nm"].value_or(0);
    if (m.i_rated == 0 && m.T_rated == 0)
      throw BadInput(
          "data sheet: rated_current_A_rms, _A_peak, _A_block or rated_torque_Nm is required");
    if (m.i_rated == 0) {
      m.i_rated = m.T_rated / m.torque_constant();
      say("i_rated_A", m.i_rated, "rated torque over K_t");
    }
    if (m.T_rated == 0) {
      m.T_rated = m.torque_constant() * m.i_rated;
      say("T_rated_Nm", m.T_rated, "K_t times the rated current");
    }
    const double v_dc = need("v_dc_V");
    if (const auto rpm = sheet_["rated_speed_rpm"]) {
      m.omega_m_rated = *rpm * kRadPerRpm;
      say("omega_m_rated_rad_s", m.omega_m_rated, fmt::format("{:g} rpm", *rpm));
    } else {  // as in model/per_unit.hpp
      m.omega_m_rated = 0.6 * v_dc / kSqrt3 / m.psi_f / m.n_p;
      result_.assumed.push_back(
          fmt::format("rated speed {:.4g} rpm: its EMF is 60 % of what v_dc allows",
                      m.omega_m_rated / kRadPerRpm));
    }
    m.B = kFrictionShare * m.T_rated / m.omega_m_rated;
    result_.assumed.push_back(
        fmt::format("B_Nms = {:.3g}: 1 % of the rated torque at the rated speed", m.B));
  }

  void time_constant() {
    const auto printed_ms = sheet_["mechanical_time_constant_ms"];
    if (!printed_ms) return;
    const MachineParameters& m = result_.machine;
    const double tau_ms = 1e3 * m.J * m.R_s / (1.5 * std::pow(m.n_p * m.psi_f, 2));
    const double ratio = tau_ms / *printed_ms;
    if (std::abs(std::log(ratio)) <= std::log(kTimeTolerance)) return;
    const bool twice = std::abs(std::log(ratio / 2)) <= std::log(kTimeTolerance);
    result_.doubts.push_back(fmt::format(
        "mechanical time constant is {:.3g} ms by R_s, J and psi_f, and {:g} ms by the sheet: {}",
        tau_ms, *printed_ms,
        twice ? "about twice: resistance line to line or phase?"
              : fmt::format("off by a factor {:.3g}", std::max(ratio, 1 / ratio))));
  }

  const Sheet& sheet_;
  MachineOfSheet result_;
};

}  // namespace

MachineOfSheet machine_of_sheet(const Sheet& sheet) {
  return Conversion(sheet).run();
}

}  // namespace twinrate

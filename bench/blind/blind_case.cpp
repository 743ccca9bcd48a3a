#include "bench/blind/blind_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "bench/blind/draw.hpp"

namespace twinrate::blind {
namespace {

using Keys = std::vector<std::pair<const char*, std::string>>;
std::string number(double value) {
  return fmt::format("{:.9g}", value);
}

constexpr double kJ = 8.8e-3, kR = 1.05, kPsi = 0.253333333, kL = 12.7e-3;

std::string one_phase(Draw& d, const char* a, const char* b, double lo, double hi) {
  const double x = d.signed_between(lo, hi), y = d.signed_between(0.2 * lo, hi);
  return fmt::format("{} = {:.9g}\n{} = {:.9g}\n", a, x, b, y);
}

// The keys of one effect, without [[effect]] and kind.
const std::map<std::string, std::function<std::string(Draw&)>>& makers() {
  const auto keys = [](const Keys& list) {
    std::string text;
    for (const auto& [key, value] : list) text += fmt::format("{} = {}\n", key, value);
    return text;
  };
  static const std::map<std::string, std::function<std::string(Draw&)>> kMakers = {
      {"cogging",
       [=](Draw& d) {
         return keys({{"order", fmt::format("{}", d.whole(2, 60))},
                      {"amplitude_Nm", number(d.between(0.02, 0.15))},
                      {"phase_rad", number(d.phase())}});
       }},
      {"coulomb_friction",
       [=](Draw& d) {
         return keys({{"torque_Nm", number(d.between(0.05, 0.4))}});
       }},
      {"stribeck_friction",
       [=](Draw& d) {
         return keys({{"torque_Nm", number(d.between(0.1, 0.3))},
                      {"speed_rad_s", number(d.between(1, 8))}});
       }},
      {"viscous_friction",
       [=](Draw& d) {
         return keys({{"coefficient_Nms", number(d.between(0.002, 0.01))}});
       }},
      {"fan_load",
       [=](Draw& d) {
         return keys({{"coefficient_Nms2", number(d.between(2e-5, 1.2e-4))}});
       }},
      {"load_step",
       [=](Draw& d) {
         return keys(
             {{"torque_Nm", number(d.between(0.15, 1))}, {"time_s", number(d.between(2, 8))}});
       }},
      {"eccentric_load",
       [=](Draw& d) {
         return keys(
             {{"amplitude_Nm", number(d.between(0.05, 0.5))}, {"phase_rad", number(d.phase())}});
       }},
      {"inertia",
       [=](Draw& d) {
         return keys({{"change_kgm2",
                       number(kJ * d.either(d.between(-0.25, -0.05), d.between(0.05, 0.5)))}});
       }},
      {"torsion",
       [=](Draw& d) {
         const double J_2 = kJ * d.between(0.15, 0.45), f = d.between(15, 60);
         const double K = J_2 * std::pow(kTwoPi * f, 2);
         return keys({{"J_load_kgm2", number(J_2)},
                      {"stiffness_Nm_rad", number(K)},
                      {"damping_Nms_rad", number(2 * d.between(0.02, 0.08) * std::sqrt(K * J_2))}});
       }},
      {"backlash",
       [=](Draw& d) {
         const double J_2 = kJ * d.between(0.2, 0.45);
         const double K = J_2 * std::pow(kTwoPi * d.between(40, 90), 2);
         return keys({{"J_load_kgm2", number(J_2)},
                      {"gap_rad", number(d.between(0.004, 0.03))},
                      {"stiffness_Nm_rad", number(K)},
                      {"damping_Nms_rad", number(0.2 * std::sqrt(K * J_2))}});
       }},
      {"friction_ripple",
       [=](Draw& d) {
         return keys({{"order", fmt::format("{}", d.whole(1, 3))},
                      {"amplitude_Nm", number(d.between(0.03, 0.12))},
                      {"phase_rad", number(d.phase())}});
       }},
      {"dead_time",
       [=](Draw& d) {
         return keys({{"dead_time_s", number(d.between(0.4e-6, 2.5e-6))},
                      {"linear_current_A", number(d.between(0.05, 0.3))}});
       }},
      {"current_offset",
       [=](Draw& d) { return one_phase(d, "offset_a_A", "offset_b_A", 0.02, 0.2); }},
      {"current_gain", [=](Draw& d) { return one_phase(d, "gain_a", "gain_b", 0.01, 0.05); }},
      {"resistance",
       [=](Draw& d) {
         const bool drift = d.either(0, 1) > 0.5;
         return keys({{"change_Ohm", number(kR * d.between(0.08, 0.45))},
                      {"time_constant_s", number(drift ? d.between(1.5, 6) : 0)}});
       }},
      {"flux_linkage",
       [=](Draw& d) {
         return keys({{"change_Wb", number(-kPsi * d.between(0.025, 0.12))}});
       }},
      {"inductance",
       [=](Draw& d) {
         return keys({{"change_d_H", number(kL * d.signed_between(0.06, 0.25))},
                      {"change_q_H", number(kL * d.signed_between(0.06, 0.25))}});
       }},
      {"saturation",
       [=](Draw& d) {
         return keys({{"form", d.either(0, 1) > 0.5 ? "\"rational\"" : "\"square\""},
                      {"current_q_A", number(d.between(8, 18))}});
       }},
      {"iron_loss",
       [=](Draw& d) {
         return keys({{"resistance_Ohm", number(d.between(150, 800))}});
       }},
      {"dc_bus_ripple",
       [=](Draw& d) {
         return keys({{"amplitude_V", number(d.between(2.5, 25))},
                      {"frequency_Hz", number(d.either(300, d.between(45, 1000)))},
                      {"phase_rad", number(d.phase())}});
       }},
      {"encoder_eccentricity",
       [=](Draw& d) {
         return keys({{"amplitude_rad", number(d.between(0.5e-3, 5e-3))},
                      {"phase_rad", number(d.phase())}});
       }},
      {"encoder_offset",
       [=](Draw& d) {
         return keys({{"offset_rad", number(d.signed_between(7e-3, 50e-3))}});
       }},
      {"voltage_gain",
       [=](Draw& d) {
         return keys({{"gain", number(d.signed_between(0.02, 0.08))}});
       }},
      {"phase_asymmetry",
       [=](Draw& d) {
         return keys({{"change_a_Ohm", number(d.between(0.05, 0.35))},
                      {"change_b_Ohm", "0"},
                      {"change_c_Ohm", "0"}});
       }},
      {"inverter_offset",
       [=](Draw& d) { return one_phase(d, "offset_a_V", "offset_b_V", 0.2, 1); }},
      {"flux_harmonics",
       [=](Draw& d) {
         return keys({{"order", fmt::format("{}", 6 * 3 * d.whole(1, 2))},
                      {"amplitude_Wb", number(kPsi * d.between(0.004, 0.02))},
                      {"phase_rad", number(d.phase())}});
       }},
      {"signal_lag",
       [=](Draw& d) {
         static const char* const kSignals[] = {"\"voltage\"", "\"current\"", "\"angle\""};
         return keys({{"signal", kSignals[d.whole(0, 2)]},
                      {"form", "\"delay\""},
                      {"lag_s", number(d.between(30e-6, 300e-6))}});
       }},
      {"adc_quantisation",
       [=](Draw& d) {
         return keys({{"lsb_A", number(d.between(0.05, 0.25))}});
       }},
      {"adc_clipping",
       [=](Draw& d) {
         return keys({{"limit_A", number(d.between(2, 3.5))}});
       }},
      {"missing_samples",
       [=](Draw& d) {
         return keys({{"share", number(d.between(0.002, 0.03))}});
       }},
      {"stale_samples",
       [=](Draw& d) {
         const std::string share = number(d.between(0.002, 0.03));
         return keys(
             {{"share", share}, {"signal", d.either(0, 1) > 0.5 ? "\"current\"" : "\"all\""}});
       }},
  };
  return kMakers;
}

// Added after figures were published, so it must not change the draws of the other kinds.
constexpr const char* kLaterKind = "dc_bus_ripple";

struct Step {
  double t, value;
};
std::string profile_text(const std::vector<Step>& steps) {
  std::string text;
  for (const Step& s : steps)
    text += fmt::format("{}[{:.4g}, {:.6g}]", text.empty() ? "" : ", ", s.t, s.value);
  return "[" + text + "]";
}

constexpr double kRpm = kTwoPi / 60;

void rich(Draw& d, double T, std::vector<Step>& rpm, std::vector<Step>& load,
          std::vector<Step>& i_d) {
  for (double t = 0; t < T;) {
    const double span = d.between(0.7, 1.1);
    const double size = d.either(d.between(20, 200), d.between(200, 850));
    const double speed = d.either(-1, 1) * size;
    rpm.push_back({t, speed});
    load.push_back({t, 0});
    i_d.push_back({t, 0});
    if (d.either(0, 1) > 0.5 || t == 0) {
      load.push_back({t + 0.45 * span, std::copysign(d.between(0.5, 4), speed)});
      if (d.either(0, 1) > 0.5) i_d.push_back({t + 0.6 * span, d.signed_between(0.5, 2)});
    } else {
      i_d.push_back({t + 0.5 * span, d.signed_between(0.5, 2)});
    }
    t += span;
  }
}

void slow(Draw& d, double T, std::vector<Step>& rpm, std::vector<Step>& load,
          std::vector<Step>& i_d) {
  const double speeds[] = {10, 20, 30, 50};
  const double direction = d.either(-1, 1);
  for (int j = 0; j < 4; ++j) rpm.push_back({T * j / 4, direction * speeds[j]});
  load.push_back({0, 0});
  i_d.push_back({0, 0});
}

void moves(Draw& d, double T, std::vector<Step>& rpm, std::vector<Step>& load,
           std::vector<Step>& i_d) {
  const double speed = d.between(60, 250), move = d.between(0.3, 0.6), pause = d.between(0.1, 0.3);
  double sign = 1;
  for (double t = 0; t < T; t += move + pause, sign = -sign) {
    rpm.push_back({t, sign * speed});
    rpm.push_back({t + move, 0});
  }
  load.push_back({0, 0});
  i_d.push_back({0, 0});
}

}  // namespace

const std::vector<std::string>& drawable_kinds() {
  static const std::vector<std::string> kKinds = [] {
    std::vector<std::string> kinds;
    for (const auto& [kind, maker] : makers())
      if (kind != kLaterKind) kinds.push_back(kind);
    return kinds;
  }();
  return kKinds;
}

Case make_case(const std::string& profile, const std::vector<std::string>& kinds,
               std::uint64_t seed) {
  Case which{.profile = profile, .seed = seed, .kinds = kinds};
  Draw d(seed * 7919 + 3);
  std::string name = profile;
  for (const std::string& kind : kinds) {
    which.effects_toml +=
        fmt::format("\n[[effect]]\nkind = \"{}\"\n{}", kind, makers().at(kind)(d));
    name += "-" + kind;
  }
  which.name = fmt::format("{}-{}", kinds.empty() ? name + "-none" : name, seed);
  return which;
}

std::vector<std::string> overrides(const Case& which, double T) {
  Draw d(which.seed * 1000003 + 17);
  std::vector<Step> rpm, load, i_d;
  if (which.profile == "rich")
    rich(d, T, rpm, load, i_d);
  else if (which.profile == "slow")
    slow(d, T, rpm, load, i_d);
  else
    moves(d, T, rpm, load, i_d);
  return {"machine.B_Nms=0.002",
          "sensors.i_lsb_A=0.009765625",
          "sensors.current_sensors=2",
          "controller.kind=foc",
          "controller.compensation=off",
          "controller.angle_source=measured",
          fmt::format("run.seed={}", which.seed),
          fmt::format("run.duration_s={}", T),
          "run.settle_s=0.1",
          "reference.speed_rpm=" + profile_text(rpm),
          "reference.slew_rad_s2=750",
          "load.T_load_Nm=" + profile_text(load),
          "load.slew_Nm_s=200",
          "reference.i_d_A=" + profile_text(i_d)};
}

}  // namespace twinrate::blind

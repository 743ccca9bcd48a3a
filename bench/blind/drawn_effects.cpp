#include "bench/blind/drawn_effects.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>

#include "model/effects/shapes.hpp"

namespace twinrate::blind {
namespace {

// Draws the keys of one effect. The sizes are multiples of the smallest size worth reporting, the
// figures of materiality() in model/effects/.
class Maker {
 public:
  Maker(Draw& d, const DrawnLogFacts& facts) : d_(d), facts_(facts) {}

  std::string take() { return std::move(text_); }
  const MachineParameters& machine() const { return facts_.drawn.machine; }
  const DrawnMachine& drawn() const { return facts_.drawn; }
  const DrawnLogFacts& facts() const { return facts_; }
  Draw& draw() { return d_; }

  void key(const char* name, double value) { text_ += fmt::format("{} = {:.9g}\n", name, value); }
  void choice(const char* name, const char* value) {
    text_ += fmt::format("{} = \"{}\"\n", name, value);
  }
  void phase() { key("phase_rad", d_.phase()); }
  double times() { return d_.log_between(3, 20); }
  double sign() { return d_.either(-1, 1); }
  // Nm; `at_8_Nm`: the smallest size worth reporting of a motor of 8.1 Nm.
  double torque(double at_8_Nm) {
    return d_.log_between(5, 60) * at_8_Nm * machine().T_rated / 8.1;
  }
  // Phases a, b and, with three sensors, c: phase a has the size, the others at most that.
  void phases(const char* a, const char* b, const char* c, double size) {
    key(a, sign() * size), key(b, size * d_.between(-1, 1));
    if (c && drawn().current_sensors == 3) key(c, size * d_.between(-1, 1));
  }

 private:
  Draw& d_;
  const DrawnLogFacts& facts_;
  std::string text_;
};

void cogging(Maker& m) {
  constexpr int kHighest = 2000;  // that a model can have
  const int slots = m.machine().n_slots, poles = 2 * m.machine().n_p;
  const int common = std::lcm(slots, poles);
  const int orders[] = {slots, poles, common <= kHighest ? common : slots, m.draw().whole(2, 60)};
  m.key("order", orders[m.draw().whole(0, 3)]);
  m.key("amplitude_Nm", m.torque(4e-3));
  m.phase();
}

void shaft(Maker& m, double share, double f_lo, double f_hi, double damping) {
  const double J_2 = share * m.machine().J, f = m.draw().log_between(f_lo, f_hi);
  const double stiffness = J_2 * std::pow(kTwoPi * f, 2);
  m.key("J_load_kgm2", J_2), m.key("stiffness_Nm_rad", stiffness);
  m.key("damping_Nms_rad", 2 * damping * std::sqrt(stiffness * J_2));
}

void signal_lag(Maker& m) {
  static const char* const kSignals[] = {"voltage", "current", "angle"};
  m.choice("signal", kSignals[m.draw().whole(0, 2)]), m.choice("form", "delay");
  // A longer lag would use up the phase margin of the current loop, or turn the voltage by 0.3 rad.
  const double omega_e = m.machine().n_p * m.machine().omega_m_rated;
  m.key("lag_s", std::min({12e-6 * m.times(), 0.06 / m.drawn().current_bandwidth, 0.3 / omega_e}));
}

void resistance(Maker& m) {
  m.key("change_Ohm", 0.02 * m.machine().R_s * m.times());
  const double tau = m.draw().between(1, 4);
  m.key("time_constant_s", m.draw().happens(0.5) ? tau : 0);
}

void saturation(Maker& m) {
  m.choice("form", m.draw().happens(0.5) ? "rational" : "square");
  m.key("current_q_A", m.machine().i_rated * m.draw().log_between(1.2, 4));
}

using Make = std::function<void(Maker&)>;

const std::map<std::string, Make>& torque_makers() {
  static const std::map<std::string, Make> kMakers = {
      {"cogging", cogging},
      {"coulomb_friction", [](Maker& m) { m.key("torque_Nm", m.torque(10e-3)); }},
      {"stribeck_friction",
       [](Maker& m) {
         m.key("torque_Nm", m.torque(20e-3));
         m.key("speed_rad_s", m.machine().omega_m_rated * m.draw().log_between(0.01, 0.08));
       }},
      {"viscous_friction",
       [](Maker& m) { m.key("coefficient_Nms", m.torque(15e-3) / m.machine().omega_m_rated); }},
      {"fan_load",
       [](Maker& m) {
         m.key("coefficient_Nms2", m.torque(15e-3) / std::pow(m.machine().omega_m_rated, 2));
       }},
      {"constant_load", [](Maker& m) { m.key("torque_Nm", m.sign() * m.torque(10e-3)); }},
      {"load_step",
       [](Maker& m) {
         m.key("torque_Nm", m.sign() * m.torque(20e-3));
         m.key("time_s", m.facts().duration_s * m.draw().between(0.2, 0.8));
       }},
      {"eccentric_load", [](Maker& m) { m.key("amplitude_Nm", m.torque(8e-3)), m.phase(); }},
      {"friction_ripple",
       [](Maker& m) {
         m.key("order", m.draw().whole(1, 3));
         m.key("amplitude_Nm", m.torque(8e-3)), m.phase();
       }},
      {"inertia",
       [](Maker& m) {
         const double share = 0.02 * m.times();
         m.key("change_kgm2", m.machine().J * m.draw().either(share, -std::min(share, 0.3)));
       }},
      {"torsion",
       [](Maker& m) {
         const double share = std::min(0.05 * m.times(), 0.6);
         shaft(m, share, 3, 100, m.draw().between(0.02, 0.08));
       }},
      {"backlash",
       [](Maker& m) {
         m.key("gap_rad", m.draw().log_between(4e-3, 0.1));
         const double share = m.draw().between(0.2, 0.45);
         shaft(m, share, 20, 100, 0.1);
       }},
  };
  return kMakers;
}

// The corner of a drop: half of them clamped, the others smooth.
void corner(Maker& m) {
  m.key("linear_current_A", m.machine().i_rated * m.draw().log_between(0.005, 0.2));
  if (m.draw().happens(0.5)) m.choice("shape", kCurrentShapeNames[m.draw().whole(1, 3)]);
}

const std::map<std::string, Make>& electrical_makers() {
  static const std::map<std::string, Make> kMakers = {
      {"dead_time",
       [](Maker& m) {
         m.key("dead_time_s", 1e-7 * m.times());
         corner(m);
       }},
      {"inverter_drop",
       [](Maker& m) {
         m.key("threshold_V", 1e-3 * m.drawn().v_dc * m.times());
         m.key("resistance_Ohm", 0.02 * m.machine().R_s * m.times());
         corner(m);
       }},
      {"inverter_offset",
       [](Maker& m) {
         m.phases("offset_a_V", "offset_b_V", nullptr, 0.05 / 235 * m.drawn().v_dc * m.times());
       }},
      {"voltage_gain", [](Maker& m) { m.key("gain", m.sign() * 0.006 * m.times()); }},
      {"resistance", resistance},
      {"phase_asymmetry",
       [](Maker& m) { m.key("change_a_Ohm", 0.02 * m.machine().R_s * m.times()); }},
      {"flux_linkage",
       [](Maker& m) { m.key("change_Wb", -0.006 * m.machine().psi_f * m.times()); }},
      {"inductance",
       [](Maker& m) {
         const double size = 0.015 * m.times();
         m.key("change_d_H", m.machine().L_d * m.sign() * size);
         m.key("change_q_H", m.machine().L_q * m.sign() * size * m.draw().between(0.5, 1));
       }},
      {"saturation", saturation},
      {"cross_saturation",
       [](Maker& m) {
         const double size = std::min(0.03 * m.times(), 0.3);
         m.key("coefficient_H_A", m.sign() * size * m.machine().L_q / m.machine().i_rated);
       }},
      {"iron_loss",
       [](Maker& m) {
         const double emf = m.machine().n_p * m.machine().omega_m_rated * m.machine().psi_f;
         m.key("resistance_Ohm", emf / (0.0075 * m.machine().i_rated * m.times()));
       }},
      {"flux_harmonics",
       [](Maker& m) {
         m.key("order", 6 * m.machine().n_p * m.draw().whole(1, 2));
         m.key("amplitude_Wb", 1e-3 * m.machine().psi_f * m.times()), m.phase();
       }},
      {"dc_bus_ripple",
       [](Maker& m) {
         m.key("amplitude_V", 3e-3 * m.drawn().v_dc * m.times());
         const double most = std::min(1000.0, 0.4 * m.facts().rate_Hz);
         const double any = m.draw().log_between(20, most);
         m.key("frequency_Hz", m.draw().happens(0.5) && most > 300 ? 300 : any), m.phase();
       }},
  };
  return kMakers;
}

const std::map<std::string, Make>& sensor_makers() {
  static const std::map<std::string, Make> kMakers = {
      {"current_offset",
       [](Maker& m) {
         m.phases("offset_a_A", "offset_b_A", "offset_c_A",
                  8e-3 / 7 * m.machine().i_rated * m.times());
       }},
      {"current_gain", [](Maker& m) { m.phases("gain_a", "gain_b", "gain_c", 0.003 * m.times()); }},
      {"encoder_offset",
       [](Maker& m) {
         m.key("offset_rad", m.sign() * std::min(2e-3 * m.times(), 0.25 / m.machine().n_p));
       }},
      {"encoder_eccentricity",
       [](Maker& m) {
         m.key("amplitude_rad", std::min(2e-4 * m.times(), 0.1 / m.machine().n_p)), m.phase();
       }},
      {"signal_lag", signal_lag},
      {"adc_quantisation",
       [](Maker& m) { m.key("lsb_A", 5e-3 * m.machine().i_rated * m.times()); }},
      {"adc_clipping",
       [](Maker& m) { m.key("limit_A", m.machine().i_rated * m.draw().between(0.5, 1.2)); }},
      {"missing_samples", [](Maker& m) { m.key("share", 1e-3 * m.times()); }},
      {"stale_samples",
       [](Maker& m) {
         m.key("share", 1e-3 * m.times());
         m.choice("signal", m.draw().happens(0.5) ? "current" : "all");
       }},
  };
  return kMakers;
}

}  // namespace

std::vector<std::string> kinds_for(bool every_tick) {
  std::vector<std::string> kinds;
  for (const auto* makers : {&torque_makers(), &electrical_makers(), &sensor_makers()})
    for (const auto& [kind, make] : *makers)
      if (every_tick || !kind.ends_with("_samples")) kinds.push_back(kind);
  return kinds;
}

std::string draw_effect(const std::string& kind, Draw& d, const DrawnLogFacts& facts) {
  Maker maker(d, facts);
  for (const auto* makers : {&torque_makers(), &electrical_makers(), &sensor_makers()})
    if (const auto found = makers->find(kind); found != makers->end()) found->second(maker);
  return fmt::format("\n[[effect]]\nkind = \"{}\"\n{}", kind, maker.take());
}

}  // namespace twinrate::blind

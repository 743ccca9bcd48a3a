#include "bench/blind/foreign_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace twinrate::blind {
namespace {

constexpr double kRoot3 = 1.7320508075688772;

void draw_foreign_machine(Draw& d, DrawnMachine& x) {
  MachineParameters& m = x.machine;
  bool fits = false;
  while (!fits) {
    x.v_dc = d.log_between(12, 560), x.f_s = 1000 * d.whole(8, 20);
    m.omega_m_rated = d.log_between(15, 700), m.i_rated = d.log_between(0.5, 70);
    m.n_p = d.whole(2, d.happens(0.5) ? 6 : 21);
    const double emf = d.between(0.45, 0.8) * x.v_dc / kRoot3;
    m.psi_f = emf / (m.n_p * m.omega_m_rated);
    m.T_rated = 1.5 * m.n_p * m.psi_f * m.i_rated;
    m.L_d = d.between(0.04, 0.5) * emf / (m.n_p * m.omega_m_rated * m.i_rated);
    m.L_q = m.L_d * (d.happens(0.4) ? d.between(1.05, 2.2) : 1);
    m.R_s = d.between(0.02, 0.15) * emf / m.i_rated;
    x.t_accelerate = d.log_between(0.03, 0.8);
    m.J = m.T_rated * x.t_accelerate / m.omega_m_rated;
    m.B = d.between(0.002, 0.04) * m.T_rated / m.omega_m_rated;
    m.n_slots = 3 * d.whole(1, std::min(24, 4 * m.n_p));
    fits = m.L_d > 4e-5 && m.L_q < 22e-3 && m.J > 1e-6 && m.J < 0.15 &&
           m.n_p * m.omega_m_rated < kTwoPi * x.f_s / 14 && m.L_d / m.R_s > 4 / x.f_s &&
           m.n_slots > m.n_p && m.n_slots != 2 * m.n_p &&
           m.n_slots % (3 * std::gcd(m.n_slots, m.n_p)) == 0;
  }
  constexpr std::array kCounts = {500,  512,  1000,  1024,  2000,    2048,    2500,
                                  4096, 8192, 10000, 16384, 1 << 16, 1 << 17, 1 << 20};
  const int counts = kCounts[static_cast<std::size_t>(d.whole(0, kCounts.size() - 1))];
  x.encoder_counts = d.happens(0.12) ? 0 : counts;
  x.counts_declared = d.happens(0.5), x.angle_noise = d.log_between(1e-5, 1e-4);
  x.current_sensors = d.whole(2, 3), x.i_range = d.between(2.2, 4) * m.i_rated;
  x.i_lsb = 2 * x.i_range / 4096, x.i_noise = x.i_lsb * d.log_between(0.4, 3);
  x.v_dc_noise = x.v_dc * d.log_between(1e-4, 1e-3);
  x.current_bandwidth = x.f_s / d.between(20, 45);
  x.speed_bandwidth = d.log_between(3, 20);
  x.filter_bandwidth = x.speed_bandwidth * d.between(6, 12);
}

using Put = std::function<void(Draw&, ForeignCase&)>;

void put_shaft(Draw& d, ForeignCase& f, double share, double f_Hz) {
  f.plant.J_load = share * f.header.drawn.machine.J;
  f.plant.stiffness = f.plant.J_load * std::pow(kTwoPi * f_Hz, 2);
  f.plant.damping = 2 * d.between(0.02, 0.1) * std::sqrt(f.plant.stiffness * f.plant.J_load);
}

const std::map<std::string, Put>& torques() {
  static const auto rated = [](const ForeignCase& f) { return f.header.drawn.machine.T_rated; };
  static const auto speed = [](const ForeignCase& f) {
    return f.header.drawn.machine.omega_m_rated;
  };
  static const std::map<std::string, Put> kPuts = {
      {"inertia",
       [](Draw& d, ForeignCase& f) {
         const double share = d.happens(0.5) ? d.log_between(0.05, 0.6) : -d.log_between(0.05, 0.3);
         f.plant.J_change = share * f.header.drawn.machine.J;
       }},
      {"coulomb_friction",
       [](Draw& d, ForeignCase& f) { f.plant.coulomb = rated(f) * d.log_between(0.01, 0.1); }},
      {"stribeck_friction",
       [](Draw& d, ForeignCase& f) {
         f.plant.stribeck = rated(f) * d.log_between(0.015, 0.1);
         f.plant.stribeck_speed = speed(f) * d.log_between(0.01, 0.08);
       }},
      {"viscous_friction",
       [](Draw& d, ForeignCase& f) {
         f.plant.viscous = rated(f) / speed(f) * d.log_between(0.01, 0.15);
       }},
      {"fan_load",
       [](Draw& d, ForeignCase& f) {
         f.plant.fan = rated(f) / std::pow(speed(f), 2) * d.log_between(0.02, 0.3);
       }},
      {"constant_load",
       [](Draw& d, ForeignCase& f) {
         f.plant.constant = d.either(-1, 1) * rated(f) * d.log_between(0.01, 0.1);
       }},
      {"load_step",
       [](Draw& d, ForeignCase& f) {
         f.plant.step = d.either(-1, 1) * rated(f) * d.log_between(0.02, 0.15);
         f.plant.t_step = f.header.duration_s * d.between(0.2, 0.8);
       }},
      {"eccentric_load",
       [](Draw& d, ForeignCase& f) {
         f.plant.eccentric = rated(f) * d.log_between(0.01, 0.08);
         f.plant.eccentric_phase = d.phase();
       }},
      {"cogging",
       [](Draw& d, ForeignCase& f) {
         const MachineParameters& m = f.header.drawn.machine;
         const int common = std::lcm(m.n_slots, 2 * m.n_p);
         const std::array orders = {m.n_slots, 2 * m.n_p, common < 500 ? common : m.n_slots};
         f.plant.cogging_order = orders[static_cast<std::size_t>(d.whole(0, 2))];
         f.plant.cogging = rated(f) * d.log_between(0.005, 0.05);
         f.plant.cogging_phase = d.phase();
       }},
      {"friction_ripple",
       [](Draw& d, ForeignCase& f) {
         f.plant.ripple = rated(f) * d.log_between(0.01, 0.06);
         f.plant.ripple_order = d.whole(1, 3), f.plant.ripple_phase = d.phase();
       }},
      {"torsion",
       [](Draw& d, ForeignCase& f) {
         put_shaft(d, f, d.between(0.15, 0.6), d.log_between(4, 100));
       }},
      {"backlash",
       [](Draw& d, ForeignCase& f) {
         put_shaft(d, f, d.between(0.2, 0.5), d.log_between(15, 80));
         f.plant.gap = d.log_between(0.005, 0.1);
       }},
  };
  return kPuts;
}

const std::map<std::string, Put>& voltages() {
  static const std::map<std::string, Put> kPuts = {
      {"resistance",
       [](Draw& d, ForeignCase& f) {
         f.plant.R_change = f.header.drawn.machine.R_s * d.log_between(0.08, 0.5);
         f.plant.R_tau = d.happens(0.5) ? 0 : d.between(1, 4);
       }},
      {"phase_asymmetry",
       [](Draw& d, ForeignCase& f) {
         f.plant.R_a = f.header.drawn.machine.R_s * d.log_between(0.08, 0.5);
       }},
      {"flux_linkage",
       [](Draw& d, ForeignCase& f) {
         f.plant.psi_change = -f.header.drawn.machine.psi_f * d.log_between(0.02, 0.12);
       }},
      {"inductance",
       [](Draw& d, ForeignCase& f) {
         const double share = d.either(-1, 1) * d.log_between(0.05, 0.3);
         f.plant.L_d_change = share * f.header.drawn.machine.L_d;
         f.plant.L_q_change = share * f.header.drawn.machine.L_q * d.between(0.5, 1);
       }},
      {"saturation",
       [](Draw& d, ForeignCase& f) {
         f.plant.saturation_A = f.header.drawn.machine.i_rated * d.log_between(1.2, 5);
       }},
      {"flux_harmonics",
       [](Draw& d, ForeignCase& f) {
         const MachineParameters& m = f.header.drawn.machine;
         f.plant.harmonic = m.psi_f * d.log_between(0.004, 0.03);
         f.plant.harmonic_order = 6 * m.n_p * d.whole(1, 2), f.plant.harmonic_phase = d.phase();
       }},
      {"iron_loss",
       [](Draw& d, ForeignCase& f) {
         const MachineParameters& m = f.header.drawn.machine;
         const double emf = m.n_p * m.omega_m_rated * m.psi_f;
         f.plant.R_iron = emf / (m.i_rated * d.log_between(0.02, 0.15));
       }},
      {"dead_time",
       [](Draw& d, ForeignCase& f) {
         const DrawnMachine& x = f.header.drawn;
         f.plant.drop_V += d.log_between(0.4e-6, 2.5e-6) * x.f_s * x.v_dc;
         f.plant.drop_zone_A = x.machine.i_rated * d.log_between(0.005, 0.1);
       }},
      {"inverter_drop",
       [](Draw& d, ForeignCase& f) {
         const DrawnMachine& x = f.header.drawn;
         f.plant.drop_V += x.v_dc * d.log_between(0.003, 0.02);
         f.plant.drop_Ohm = x.machine.R_s * d.between(0.05, 0.3);
         f.plant.drop_zone_A = x.machine.i_rated * d.log_between(0.005, 0.1);
       }},
      {"voltage_gain",
       [](Draw& d, ForeignCase& f) { f.plant.gain = d.either(-1, 1) * d.log_between(0.015, 0.1); }},
      {"inverter_offset",
       [](Draw& d, ForeignCase& f) {
         f.plant.offset_a_V = d.either(-1, 1) * f.header.drawn.v_dc * d.log_between(0.001, 0.006);
         f.plant.offset_b_V = d.between(-1, 1) * f.plant.offset_a_V;
       }},
      {"dc_bus_ripple",
       [](Draw& d, ForeignCase& f) {
         f.plant.bus_V = f.header.drawn.v_dc * d.log_between(0.008, 0.05);
         f.plant.bus_Hz = d.happens(0.5) ? 300 : d.log_between(20, 350);
         f.plant.bus_phase = d.phase();
       }},
  };
  return kPuts;
}

// Phase a has the size, the others at most that; a third sensor only where there is one.
std::array<double, 3> three(Draw& d, const ForeignCase& f, double size) {
  const double third = f.header.drawn.current_sensors == 3 ? d.between(-1, 1) * size : 0;
  return {d.either(-1, 1) * size, d.between(-1, 1) * size, third};
}

const std::map<std::string, Put>& readings() {
  static const auto lag = [](Draw& d, const ForeignCase& f) {
    const MachineParameters& m = f.header.drawn.machine;
    return std::min(
        {d.log_between(3e-5, 2e-4), 0.25 / (m.n_p * m.omega_m_rated), 0.99 / f.header.drawn.f_s});
  };
  static const std::map<std::string, Put> kPuts = {
      {"current_offset",
       [](Draw& d, ForeignCase& f) {
         f.sensors.offset_A =
             three(d, f, f.header.drawn.machine.i_rated * d.log_between(0.004, 0.03));
       }},
      {"current_gain",
       [](Draw& d, ForeignCase& f) { f.sensors.gain = three(d, f, d.log_between(0.01, 0.06)); }},
      {"encoder_offset",
       [](Draw& d, ForeignCase& f) {
         f.sensors.offset_rad =
             d.either(-1, 1) * d.log_between(0.02, 0.15) / f.header.drawn.machine.n_p;
       }},
      {"encoder_eccentricity",
       [](Draw& d, ForeignCase& f) {
         f.sensors.eccentric_rad = d.log_between(0.005, 0.08) / f.header.drawn.machine.n_p;
         f.sensors.eccentric_phase = d.phase();
       }},
      {"signal_lag",
       [](Draw& d, ForeignCase& f) {
         double* const late[] = {&f.plant.late_voltage_s, &f.sensors.late_current_s,
                                 &f.sensors.late_angle_s};
         *late[d.whole(0, 2)] = lag(d, f);
       }},
      {"adc_clipping",
       [](Draw& d, ForeignCase& f) {
         f.sensors.clip_A = f.header.drawn.machine.i_rated * d.between(0.4, 0.9);
       }},
      {"missing_samples",
       [](Draw& d, ForeignCase& f) { f.sensors.missing = d.log_between(0.003, 0.02); }},
      {"stale_samples",
       [](Draw& d, ForeignCase& f) {
         f.sensors.stale = d.log_between(0.003, 0.02);
         f.sensors.stale_currents_only = d.happens(0.5);
       }},
  };
  return kPuts;
}

void draw_kinds(Draw& d, ForeignCase& f, int count) {
  std::vector<std::pair<std::string, Put>> all;
  for (const auto* puts : {&torques(), &voltages(), &readings()})
    for (const auto& [kind, put] : *puts)
      if (f.header.every == 1 || !kind.ends_with("_samples")) all.emplace_back(kind, put);
  std::vector<std::string>& kinds = f.header.kinds;
  f.plant.sticks = d.happens(0.4);
  while (static_cast<int>(kinds.size()) < count) {
    const auto& [kind, put] =
        all[static_cast<std::size_t>(d.whole(0, static_cast<int>(all.size()) - 1))];
    const bool second_shaft = f.plant.J_load > 0 && (kind == "torsion" || kind == "backlash");
    if (second_shaft || std::count(kinds.begin(), kinds.end(), kind) > 0) continue;
    kinds.push_back(kind);
    put(d, f);
  }
}

std::function<double(double)> steps_of(std::vector<std::pair<double, double>> steps) {
  return [steps = std::move(steps)](double t) {
    double value = 0;
    for (const auto& [at, to] : steps)
      if (at <= t) value = to;
    return value;
  };
}

std::vector<std::pair<double, double>> spans(
    double end, const std::function<std::pair<double, double>()>& next) {
  std::vector<std::pair<double, double>> steps;
  for (double t = 0; t < end;) {
    const auto [span, value] = next();
    steps.emplace_back(t, value);
    t += span;
  }
  return steps;
}

}  // namespace

Motion draw_motion(Draw& d, ForeignCase& f) {
  DrawnCase& c = f.header;
  const MachineParameters& m = c.drawn.machine;
  const double omega = m.omega_m_rated, end = c.duration_s + f.before_s, side = d.either(-1, 1);
  const std::string& p = c.profile;
  Motion motion;
  motion.speed = steps_of({{0, side * d.between(0.15, 0.85) * omega}});  // steady
  if (p == "one_start")
    motion.speed = steps_of({{d.between(0.2, 0.6), side * d.between(0.2, 0.85) * omega}});
  if (p == "rich" || p == "stairs" || p == "slow")
    motion.speed = steps_of(spans(end, [&] {
      const double size = p == "slow" ? d.log_between(0.02, 0.06) : d.log_between(0.05, 0.85);
      const double to = (p == "rich" ? d.either(-1, 1) : side) * size * omega;
      return std::pair(d.between(0.3, 1.3), to);
    }));
  if (p == "p2p" || p == "jog") {
    const double fast = d.between(0.15, 0.6) * omega;
    double turn = side;
    bool moves = false;
    motion.speed = steps_of(spans(end, [&] {
      moves = !moves;
      if (moves) turn = p == "p2p" ? -turn : d.either(-1, 1);
      const double to = p == "p2p" ? fast : d.between(0.05, 0.3) * omega;
      const double span = p == "p2p" ? d.between(0.25, 0.7) : d.between(0.08, 0.3);
      return moves ? std::pair(span, turn * to) : std::pair(d.between(0.05, 0.3), 0.0);
    }));
  }
  if (p == "prbs") {
    const double mean = side * d.between(0.2, 0.6) * omega, step = d.between(0.05, 0.2) * omega;
    motion.speed = steps_of(
        spans(end, [&] { return std::pair(0.06 * d.whole(1, 5), mean + d.either(-1, 1) * step); }));
  }
  if (p == "sines") {
    std::array<std::array<double, 3>, 4> waves{};
    for (auto& [size, f_Hz, phase] : waves)
      size = d.between(0.05, 0.3) * omega, f_Hz = d.log_between(0.2, 4), phase = d.phase();
    const double mean = d.happens(0.5) ? 0 : d.between(-0.3, 0.3) * omega;
    motion.jumps = false;
    motion.speed = [=](double t) {
      double sum = mean;
      for (const auto& [size, f_Hz, phase] : waves)
        sum += size * std::sin(kTwoPi * f_Hz * t + phase);
      return sum;
    };
  }
  if (p == "chirp") {
    const double first = 0.2, last = std::min(6.0, 1 / c.drawn.t_accelerate),
                 mean = d.happens(0.5) ? 0 : d.between(-0.3, 0.3) * omega;
    motion.jumps = false;
    motion.speed = [=, t_acc = c.drawn.t_accelerate](double t) {
      const double rate = (last - first) / end, f_Hz = first + rate * t;
      const double size = 0.3 * std::min(1.0, 0.5 + 0.5 / (t_acc * f_Hz));
      return mean + size * omega * std::sin(kTwoPi * (first * t + 0.5 * rate * t * t));
    };
  }
  if (p == "torque")
    motion.turn_around = d.between(0.2, 0.6) * omega, motion.i_q = d.between(0.15, 0.5) * m.i_rated;
  const bool loads = c.mode != "angle_current" && (p == "rich" || p == "stairs") && d.happens(0.6);
  c.with_load = loads;
  if (loads) {
    bool on = false;
    motion.load = steps_of(spans(end, [&] {
      on = !on;
      return std::pair(d.between(0.2, 0.9), on ? d.signed_between(0.1, 0.6) * m.T_rated : 0);
    }));
  }
  if (c.mode != "angle_current" && (p == "rich" || p == "sines" || p == "torque") &&
      d.happens(0.7)) {
    const double i_d = d.between(-0.4, 0.2) * m.i_rated;
    motion.i_d = [i_d](double t) { return std::fmod(t, 1.3) > 0.8 ? i_d : 0; };
  }
  return motion;
}

ForeignCase draw_foreign_case(Draw& d, std::uint64_t seed, int attempt) {
  static const char* const kProfiles[] = {"rich", "rich", "sines",  "p2p",       "chirp",  "stairs",
                                          "prbs", "jog",  "steady", "one_start", "torque", "slow"};
  static const char* const kModes[] = {"full",      "full",          "full",  "decimated",
                                       "decimated", "angle_current", "novolt"};
  ForeignCase f;
  DrawnCase& c = f.header;
  c.seed = seed, c.attempt = attempt, c.name = fmt::format("foreign{}", seed);
  draw_foreign_machine(d, c.drawn);
  c.profile = kProfiles[d.whole(0, 11)], c.mode = kModes[d.whole(0, 6)];
  c.duration_s = d.between(4, 9);
  f.before_s = d.happens(0.35) && c.profile != "one_start" ? d.between(0.3, 1.5) : 0;
  const bool slower = c.mode == "novolt" ? d.happens(0.5) : c.mode != "full";
  const double rate_Hz = d.log_between(200, c.mode == "decimated" ? 4000 : 2500);
  c.every = slower ? std::max(1, static_cast<int>(std::lround(c.drawn.f_s / rate_Hz))) : 1;
  c.mean_voltage = c.every > 1 && d.happens(0.5);
  c.slew_rad_s2 = c.drawn.machine.omega_m_rated / (c.drawn.t_accelerate * d.between(1.2, 3));
  f.decoupled = d.happens(0.7), f.integral = d.between(0.15, 0.5);
  f.dither_V = d.happens(0.15) ? d.between(0.005, 0.035) * c.drawn.v_dc : 0;
  draw_kinds(d, f, seed % 2 ? d.whole(1, 3) : 0);
  return f;
}

}  // namespace twinrate::blind

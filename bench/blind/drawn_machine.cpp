#include "bench/blind/drawn_machine.hpp"

#include <fmt/format.h>

#include <array>
#include <numbers>
#include <numeric>
#include <optional>
#include <vector>

namespace twinrate::blind {
namespace {

// Slots of a balanced three-phase winding: 0.2 to 2 per pole and phase, at most 72.
int draw_slots(Draw& d, int n_p) {
  std::vector<int> allowed;
  for (int slots = 3; slots <= std::min(72, 12 * n_p); slots += 3)
    if (slots > 1.1 * n_p && slots != 2 * n_p && slots % (3 * std::gcd(slots, n_p)) == 0)
      allowed.push_back(slots);
  return allowed[static_cast<std::size_t>(d.whole(0, static_cast<int>(allowed.size()) - 1))];
}

std::optional<DrawnMachine> try_machine(Draw& d) {
  DrawnMachine x;
  MachineParameters& m = x.machine;
  x.v_dc = d.log_between(12, 560);
  x.f_s = 1000 * d.whole(8, 20);
  m.n_p = static_cast<int>(d.log_between(2, 22));
  m.n_slots = draw_slots(d, m.n_p);
  m.omega_m_rated = d.log_between(30, 800);
  m.i_rated = d.log_between(0.5, 60);
  const double emf = d.between(0.5, 0.75) * x.v_dc * std::numbers::inv_sqrt3;
  m.psi_f = emf / (m.n_p * m.omega_m_rated);
  m.T_rated = m.torque_constant() * m.i_rated;
  m.L_d = d.log_between(0.05, 0.45) * emf / (m.n_p * m.omega_m_rated * m.i_rated);
  m.L_q = m.L_d * (d.happens(1.0 / 3) ? d.between(1.1, 2) : 1);
  m.R_s = d.log_between(0.03, 0.3) * m.T_rated * m.omega_m_rated / (1.5 * m.i_rated * m.i_rated);
  x.t_accelerate = d.log_between(0.05, 1);
  m.J = x.t_accelerate * m.T_rated / m.omega_m_rated;
  m.B = d.log_between(0.003, 0.05) * m.T_rated / m.omega_m_rated;
  const bool in_range = m.L_d > 0.05e-3 && m.L_q < 20e-3 && m.J > 1e-6 && m.J < 0.1 &&
                        m.n_p * m.omega_m_rated < kTwoPi * x.f_s / 16 && m.L_d / m.R_s > 4 / x.f_s;
  return in_range ? std::optional(x) : std::nullopt;
}

void draw_sensors(Draw& d, DrawnMachine& x) {
  constexpr std::array kCounts = {512,  1000, 1024,  1440,  2000,    2048,
                                  4096, 8192, 16384, 16384, 1 << 17, 1 << 20};
  const bool sine_cosine = d.happens(0.15);
  x.encoder_counts =
      sine_cosine ? 0 : kCounts[static_cast<std::size_t>(d.whole(0, kCounts.size() - 1))];
  x.angle_noise = d.log_between(1e-5, 1e-4);
  x.counts_declared = d.happens(0.5) && !sine_cosine;
  x.current_sensors = d.whole(2, 3);
  x.i_range = d.between(2.5, 4) * x.machine.i_rated;
  x.i_lsb = 2 * x.i_range / 4096;
  x.i_noise = x.i_lsb * d.log_between(0.6, 2.5);
  x.v_dc_noise = x.v_dc * d.log_between(2e-4, 1e-3);
}

}  // namespace

DrawnMachine draw_machine(Draw& d) {
  std::optional<DrawnMachine> found;
  while (!found) found = try_machine(d);
  draw_sensors(d, *found);
  found->current_bandwidth = found->f_s / d.between(20, 40);
  found->speed_bandwidth = d.log_between(4, 18);
  found->filter_bandwidth = found->speed_bandwidth * d.between(6, 11);
  return *found;
}

std::string drive_toml(const DrawnMachine& x, const std::string& name, int counts) {
  const MachineParameters& m = x.machine;
  std::string text = fmt::format("name = \"{}\"\n\n[machine]\n", name);
  const auto number = [&](const char* key, double value) {
    text += fmt::format("{} = {:.10g}\n", key, value);
  };
  number("R_s_Ohm", m.R_s), number("L_d_H", m.L_d), number("L_q_H", m.L_q);
  number("psi_f_Wb", m.psi_f), number("n_p", m.n_p), number("n_slots", m.n_slots);
  number("J_kgm2", m.J), number("B_Nms", m.B), number("i_rated_A", m.i_rated);
  number("T_rated_Nm", m.T_rated), number("omega_m_rated_rad_s", m.omega_m_rated);
  text += "\n[inverter]\n", number("v_dc_V", x.v_dc);
  text += "\n[sensors]\n";
  number("i_noise_rms_A", x.i_noise), number("i_lsb_A", x.i_lsb);
  number("current_sensors", x.current_sensors), number("encoder_counts", counts);
  text += "\n[rates]\n", number("f_s_Hz", x.f_s), number("n", 1);
  text += "\n[estimator]\nkind = \"ekf_disturbance\"\nprediction = \"exact\"\n";
  text += "\n[controller]\nkind = \"foc\"\nangle_source = \"measured\"\n";
  text += "\n[controller.foc]\n";
  number("current_bandwidth_Hz", x.current_bandwidth);
  number("speed_bandwidth_Hz", x.speed_bandwidth), number("i_max_A", x.i_max());
  text += "\n[reference]\n", number("omega_e_rad_s", 0.5 * m.n_p * m.omega_m_rated);
  return text;
}

}  // namespace twinrate::blind

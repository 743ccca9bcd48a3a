#include "bench/random_drive.hpp"

#include <fmt/format.h>

#include <cmath>
#include <random>

#include "controller/controller.hpp"
#include "estimator/registry.hpp"
#include "model/frames.hpp"

namespace twinrate::bench {
namespace {

class Draw {
 public:
  Draw(std::uint64_t seed, std::uint64_t index) {
    std::seed_seq both{seed, index};
    engine_.seed(both);
  }
  // Without std's distributions, which differ between libraries.
  double uniform(double lo, double hi) {
    return lo + (hi - lo) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  double log_uniform(double lo, double hi) { return std::exp(uniform(std::log(lo), std::log(hi))); }
  int whole(int lo, int hi) {
    return lo + static_cast<int>(engine_() % static_cast<std::uint64_t>(hi - lo + 1));
  }
  template <class List>
  auto one_of(const List& list) {
    return list[engine_() % std::size(list)];
  }

 private:
  std::mt19937_64 engine_;
};

struct Machine {
  int n_p = 0;
  double f_s = 0, v_dc = 0, L_q = 0, L_d = 0, omega_e = 0, psi_f = 0, i = 0, R_s = 0;
  double T = 0, J = 0, B = 0;
};

Machine draw_machine(Draw& draw) {
  Machine m;
  m.n_p = draw.whole(2, 21);
  m.f_s = std::round(draw.log_uniform(5e3, 20e3));
  m.v_dc = draw.log_uniform(12, 600);
  m.L_q = draw.log_uniform(0.05e-3, 20e-3);
  m.L_d = m.L_q * (draw.whole(0, 1) == 0 ? 1 : draw.uniform(0.4, 1));
  m.omega_e = kTwoPi * m.f_s / draw.log_uniform(25, 400);
  const double e = draw.uniform(0.5, 0.75) * m.v_dc / std::sqrt(3.0);
  m.psi_f = e / m.omega_e;
  m.i = draw.log_uniform(0.05, 0.6) * e / (m.omega_e * m.L_q);
  m.R_s = draw.log_uniform(0.02, 0.2) * e / m.i;
  m.T = 1.5 * m.n_p * m.psi_f * m.i;
  const double omega_m = m.omega_e / m.n_p;
  m.J = draw.log_uniform(0.02, 0.5) * m.T / omega_m;
  m.B = draw.log_uniform(1e-3, 1e-2) * m.T / omega_m;
  return m;
}

std::string machine_tables(const Machine& m, Draw& draw) {
  return fmt::format(
      "[machine]\nR_s_Ohm = {:.5e}\nL_d_H = {:.5e}\nL_q_H = {:.5e}\npsi_f_Wb = {:.5e}\nn_p = {}\n"
      "J_kgm2 = {:.5e}\nB_Nms = {:.5e}\ni_rated_A = {:.5e}\nT_rated_Nm = {:.5e}\n"
      "omega_m_rated_rad_s = {:.5e}\n\n[inverter]\nv_dc_V = {:.4e}\n\n"
      "[sensors]\ni_noise_rms_A = {:.3e}\nencoder_counts = {}\n\n",
      m.R_s, m.L_d, m.L_q, m.psi_f, m.n_p, m.J, m.B, m.i, m.T, m.omega_e / m.n_p, m.v_dc,
      5e-3 * m.i, 1 << draw.whole(12, 20));
}

}  // namespace

RandomDrive draw_drive(std::uint64_t seed, std::uint64_t index) {
  Draw draw(seed, index);
  const Machine m = draw_machine(draw);
  RandomDrive drive;
  drive.estimator = draw.one_of(filter_kinds());
  drive.controller = draw.one_of(controller_kinds());
  drive.start = draw.one_of(kStartNames);
  drive.policy = draw.one_of(kGainPolicyNames);
  drive.n = draw.one_of(std::vector<int>{1, 2, 3, 5, 7, 10, 14, 20});
  const char* prediction = draw.one_of(kPredictionNames);
  const double omega_e = draw.uniform(0.2, 1) * m.omega_e, load = draw.uniform(0, 0.8) * m.T;
  drive.machine =
      fmt::format("n_p {}, f_s {:.0f}, L {:.3g}/{:.3g} mH, f_e {:.4g} of {:.4g} Hz", m.n_p, m.f_s,
                  1e3 * m.L_d, 1e3 * m.L_q, omega_e / (kTwoPi), m.omega_e / (kTwoPi));
  drive.text =
      fmt::format("name = \"random {} of seed {}\"\nstart = \"{}\"\n\n", index, seed, drive.start) +
      machine_tables(m, draw) +
      fmt::format(
          "[rates]\nf_s_Hz = {:.0f}.0\n{}\n[gain]\npolicy = \"{}\"\n\n"
          "[estimator]\nkind = \"{}\"\nprediction = \"{}\"\n\n[controller]\nkind = \"{}\"\n\n"
          "[reference]\nomega_e_rad_s = {:.5e}\nslew_rad_s2 = {:.5e}\n\n"
          "[load]\nT_load_Nm = [[0.0, 0.0], [1.2, {:.5e}]]\nslew_Nm_s = {:.5e}\n\n"
          "[run]\nduration_s = 2.4\nsettle_s = 1.6\n",
          m.f_s, drive.policy == "scheduled" ? "" : fmt::format("n = {}\n", drive.n), drive.policy,
          drive.estimator, prediction, drive.controller, omega_e, omega_e / 0.5, load,
          std::max(load, 0.01 * m.T) / 0.05);
  return drive;
}

}  // namespace twinrate::bench
